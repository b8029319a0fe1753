"""The programs in examples/ work as described."""

import json
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.system.conftest import AT_ONCE, PAPERS, CcrHost

EXAMPLES = Path(__file__).parents[2] / "examples"
pytestmark = pytest.mark.long


def run(name: str, folder: Path, *words: str) -> str:
    """What an example prints."""
    ended = subprocess.run(
        [sys.executable, EXAMPLES / name, *words],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    return ended.stdout


@pytest.fixture
def run_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """The same in this process, which has imported nearly all of what an example imports."""

    def run_it(name: str, *words: str) -> str:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, *words])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        out, err = capsys.readouterr()
        assert err == ""
        return out

    return run_it


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.\d+", text)]


def test_two_motors_move_the_tip(tmp_path: Path) -> None:
    told = run("move_two_motors.py", tmp_path).splitlines()
    hanging, first, both = (numbers(line) for line in told)
    assert abs(first[2] - hanging[2]) > 10, "motor 1 moves the tip along z"
    assert abs(both[1] - first[1]) > 5, "motor 2 moves it along y"


def test_the_controller_beats_the_open_loop_and_its_run_can_be_read(
    run_here: Callable[..., str], tmp_path: Path
) -> None:
    mean_mm, open_mm = numbers(run_here("own_controller.py"))
    assert mean_mm < open_mm / 2
    (folder,) = (tmp_path / "runs").iterdir()
    told = run_here("read_run.py", str(folder))
    assert "8shape under python:IntegralFeedback: 80 steps" in told
    assert numbers(told)[0] == pytest.approx(mean_mm, abs=0.1)
    assert "event: following the path" in told


def test_the_own_tracker_closes_the_loop(run_here: Callable[..., str]) -> None:
    assert numbers(run_here("own_tracker.py"))[0] < 10


def test_the_plant_is_the_model(run_here: Callable[..., str]) -> None:
    assert numbers(run_here("own_plant.py"))[0] < 0.5


def test_the_pid_policy_reaches_and_the_random_one_does_not(run_here: Callable[..., str]) -> None:
    random_mm, pid_mm = numbers(run_here("gym_policies.py"))
    assert pid_mm < 10 < random_mm


def test_the_command_takes_all_three(ccr_host: CcrHost, short_path: str) -> None:
    for option, name in (
        ("--controller", "own_controller.py:IntegralFeedback"),
        ("--tracker", "own_tracker.py:CoarseCamera"),
        ("--plant", "own_plant.py:ConstantCurvaturePlant"),
    ):
        given = (*PAPERS, *AT_ONCE, option, str(EXAMPLES / name))
        ended = ccr_host("track", short_path, "--no-open", "--json", *given)
        assert ended.status == 0, ended.err


def test_the_notebook_is_kept_without_what_it_prints() -> None:
    notebook = json.loads((EXAMPLES / "first_steps.ipynb").read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(code) > 3
    assert not any(cell["outputs"] for cell in code), "the site's build makes them"
