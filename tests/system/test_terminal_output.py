"""Progress and colours are for terminals; what goes into a pipe or a file is plain text."""

from __future__ import annotations

import os
from pathlib import Path

import pexpect
import pytest

from tests.system.conftest import COMMAND, CcrHost

COLOUR = "\x1b[3"
WORDS = ("track", "short.csv", "--no-open", "--controller", "mpc")


def on_a_terminal(folder: Path, *words: str, **environment: str) -> str:
    terminal = pexpect.spawn(
        COMMAND,
        list(words),
        cwd=folder,
        env=os.environ | {"TERM": "xterm-256color"} | environment,
        dimensions=(40, 110),
        timeout=30,
        encoding="utf-8",
    )
    terminal.expect(pexpect.EOF)
    terminal.close()
    assert terminal.exitstatus == 0
    return terminal.before


@pytest.mark.usefixtures("short_path")
def test_a_pipe_gets_neither_colours_nor_a_moving_bar(ccr_host: CcrHost) -> None:
    ended = ccr_host(*WORDS)
    assert ended.status == 0
    assert "mean of |f_m - f|" in ended.out
    assert "\x1b" not in ended.out + ended.err
    assert "arming" not in ended.out + ended.err


@pytest.mark.usefixtures("short_path")
def test_a_terminal_sees_one_line_of_progress_with_step_and_error(tmp_path: Path) -> None:
    shown = on_a_terminal(tmp_path, *WORDS)
    assert "short, mpc" in shown
    assert "/6" in shown
    assert "error" in shown
    assert "mean of |f_m - f|" in shown


def test_colours_are_for_terminals_and_left_out_on_request(tmp_path: Path) -> None:
    assert COLOUR in on_a_terminal(tmp_path, "doctor")
    assert COLOUR not in on_a_terminal(tmp_path, "doctor", NO_COLOR="1")
