"""What is allowed but hardly meant is told in one line each before a run."""

import pytest

from ccr_host.commands.options import print_notes
from ccr_host.run.options import RunOptions


def noted(capsys: pytest.CaptureFixture[str], *runs: RunOptions) -> list[str]:
    print_notes(runs)
    shown = capsys.readouterr()
    assert not shown.out
    return shown.err.splitlines()


def run(controller: str, rate_hz: float) -> RunOptions:
    return RunOptions(path="8shape", controller=controller, rate_hz=rate_hz)


def test_mpc_faster_than_its_delays_allow_is_told_with_what_to_take(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (line,) = noted(capsys, run("mpc", 20.0), run("mpc", 20.0), run("pid-ik", 20.0))
    assert line.startswith("note: mpc leaves out the delays")
    assert line.endswith("take mpc-offset or pid-ik or adaptive")


@pytest.mark.parametrize("controller", ["adaptive", "pid-ik", "mpc-offset", "open-loop"])
def test_other_controllers_suit_any_rate(
    capsys: pytest.CaptureFixture[str], controller: str
) -> None:
    assert noted(capsys, run(controller, 20.0), run("mpc", 1.0)) == []


def test_a_real_board_with_a_simulated_robot_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    half_real = RunOptions(path="8shape", device="serial:/dev/ttyACM0")
    (line,) = noted(capsys, half_real)
    assert line.startswith("note: the board is on serial:/dev/ttyACM0")
