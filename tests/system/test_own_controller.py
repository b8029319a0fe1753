"""User-supplied controllers and simulated robots, from the user's point of view."""

from pathlib import Path

import pytest

from tests.system.conftest import CcrHost
from tests.system.test_sweep import NARROW

MINE = """
import os
import numpy as np
from ccr_host.control.base import Command, Outcome
from ccr_host.sim.robot.robot import TwinRobot

class Mine:
    def __init__(self, description): pass
    def start(self, reference): return Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)
    def step(self, observation):
        print('a debug print')
        os.write(1, b'what a C library prints\\n')
        if observation.step == 3:
            {deed}
        return Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)

class Arm(TwinRobot):
    def __init__(self, description): super().__init__(description.twin)
"""


@pytest.mark.parametrize(
    ("deed", "told", "last"),
    [
        ("1 / 0", "Mine.step has failed: ZeroDivisionError", "ZeroDivisionError: division by zero"),
        ("return None", "Mine.step has answered NoneType instead of a Command", ""),
    ],
)
@pytest.mark.parametrize("realtime", [[], ["--realtime"]])
def test_it_is_reported_in_one_line_then_its_traceback_and_log_and_figure_are_saved(
    ccr_host: CcrHost,
    tmp_path: Path,
    short_path: str,
    deed: str,
    told: str,
    last: str,
    realtime: list[str],
) -> None:
    script = tmp_path / "mine.py"
    script.write_text(MINE.format(deed=deed))
    words = ["track", short_path, "--controller", "mine.py:Mine", "--no-open", "--out", "kept"]
    ended = ccr_host(*words, "--json", *realtime, drawn=True)
    assert ended.status == 2
    line, _, trace = ended.err[ended.err.index("ccr-host: error:") :].partition("\n")
    assert told in line
    assert "the robot is disarmed" in line
    assert trace.strip().endswith(last)
    assert trace.startswith("Traceback") == bool(last)
    assert "a debug print" in ended.err
    assert "what a C library prints" in ended.err
    summary = ended.summary
    assert summary["steps"] == 3
    assert told in summary["faults"][0]
    for name in ("figure.png", "run.json", "log_0000.mcap"):
        assert (tmp_path / "kept" / name).stat().st_size > 0


@pytest.mark.long
def test_every_command_that_takes_a_run_takes_them(
    ccr_host: CcrHost, tmp_path: Path, short_path: str
) -> None:
    (tmp_path / "mine.py").write_text(MINE.format(deed="pass"))
    own = ["--controller", "mine.py:Mine", "--plant", "mine.py:Arm"]
    for words in (
        ["track", short_path, "--with-open", "--unchecked", "--out", "kept"],
        ["compare", "--path", short_path, "--controller", "open-loop", "--unchecked"],
        ["sweep", "--path", short_path, "--rate", "2", "--runs", "1", *NARROW, "--out", "swept"],
    ):
        ended = ccr_host(*words, *own, "--json")
        assert ended.status == 0, ended.err
        told = ended.summary
        runs = told.get("groups") or told.get("runs") or [told]
        assert runs[-1]["controller"] == "mine.py:Mine"
        assert runs[-1].get("twin_floor_mean_error_mm") is None
    for words in (["replay", "kept"], ["report", "kept"], ["export", "kept"]):
        ended = ccr_host(*words)
        assert ended.status == 0, ended.err
    (tmp_path / "mine.py").rename(tmp_path / "moved.py")
    gone = ccr_host("replay", "kept")
    assert gone.status == 2
    assert "controller mine.py: No such file" in gone.err
    assert ccr_host("replay", "kept", "--controller", "moved.py:Mine").status == 0
    assert ccr_host("report", "kept").status == 0
