"""A user's own controller that fails, as its user sees it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

MINE = """
import numpy as np
from ccr_host.cli import main
from ccr_host.control import registry
from ccr_host.control.base import Command, Outcome

class Mine:
    name = "mine"
    def __init__(self, description): pass
    def start(self, reference): return Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)
    def step(self, observation):
        if observation.step == 3:
            {deed}
        return Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)

registry._MAKERS["mine"] = Mine
if __name__ == "__main__":
    main()
"""


@pytest.mark.parametrize(
    ("deed", "told", "last"),
    [
        ("1 / 0", "Mine.step has failed: ZeroDivisionError", "ZeroDivisionError: division by zero"),
        ("return None", "Mine.step has answered NoneType instead of a Command", ""),
    ],
)
@pytest.mark.parametrize("realtime", [[], ["--realtime"]])
def test_it_is_told_in_one_line_then_its_traceback_and_log_and_figure_are_kept(
    tmp_path: Path, short_path: str, deed: str, told: str, last: str, realtime: list[str]
) -> None:
    script = tmp_path / "mine.py"
    script.write_text(MINE.format(deed=deed))
    words = ["track", short_path, "--controller", "mine", "--no-open", "--json", "--out", "kept"]
    ended = subprocess.run(
        [sys.executable, script, *words, *realtime],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    line, _, trace = ended.stderr[ended.stderr.index("ccr-host: error:") :].partition("\n")
    assert told in line
    assert "the robot is disarmed" in line
    assert trace.strip().endswith(last)
    assert trace.startswith("Traceback") == bool(last)
    summary = json.loads(ended.stdout)
    assert summary["steps"] == 3
    assert told in summary["faults"][0]
    for name in ("figure.png", "run.json", "log_0000.mcap"):
        assert (tmp_path / "kept" / name).stat().st_size > 0
