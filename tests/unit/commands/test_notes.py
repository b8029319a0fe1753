"""What is allowed but hardly meant is told in one line each before a run."""

import pytest

from ccr_host.commands.options import print_notes
from ccr_host.run.options import RunOptions


def noted(capsys: pytest.CaptureFixture[str], *runs: RunOptions) -> list[str]:
    print_notes(runs)
    shown = capsys.readouterr()
    assert not shown.out
    return shown.err.splitlines()


def run(controller: str, rate_hz: float, robot: str = "default") -> RunOptions:
    return RunOptions(path="8shape", robot=robot, controller=controller, rate_hz=rate_hz)


def test_mpc_as_printed_faster_than_its_delays_allow_is_told_with_what_to_take(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fast = [run(name, 20.0, "paper") for name in ("mpc", "mpc", "pid-ik")]
    (line,) = noted(capsys, *fast)
    assert line.startswith("note: mpc as printed (control.bending = commanded) leaves out")
    assert line.endswith("take --set control.bending=estimated, or adaptive")


@pytest.mark.parametrize("controller", ["adaptive", "pid-ik", "mpc-offset", "open-loop", "mpc"])
def test_other_controllers_suit_any_rate(
    capsys: pytest.CaptureFixture[str], controller: str
) -> None:
    assert noted(capsys, run(controller, 20.0), run("mpc", 1.0)) == []


def test_a_real_board_with_a_simulated_robot_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    half_real = RunOptions(path="8shape", device="serial:/dev/ttyACM0")
    (line,) = noted(capsys, half_real)
    assert line.startswith("note: the board is on serial:/dev/ttyACM0")
