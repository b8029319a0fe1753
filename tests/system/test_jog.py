"""The command ``jog`` in a driven terminal."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.conftest import PATIENT_BOARD, CcrHost
from tests.system.driven_terminal import LEFT, UP, DrivenTerminal


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[DrivenTerminal]:
    terminal = DrivenTerminal(tmp_path, "jog", *PATIENT_BOARD)
    yield terminal
    terminal.kill()


def test_arrows_move_the_motors_on_the_board(terminal: DrivenTerminal) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press(UP + UP + LEFT)
    terminal.wait_for(r"motor 1 +2\.00 +2\.00 +1522\.0")
    terminal.wait_for(r"motor 2 +-1\.00 +-1\.00 +1489\.0")
    terminal.press("q")
    assert "disarmed" in terminal.end()
    assert terminal.status == 0


def test_the_stop_key_takes_the_pulses_away_and_another_key_arms_again(
    terminal: DrivenTerminal,
) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press(" ")
    stopped = terminal.wait_for("board: stopped; stopped by key")
    assert re.search(r"motor 1 .*none", stopped)
    terminal.press(UP)
    terminal.press("c")
    terminal.wait_for("board: hold|board: active")
    terminal.press("q")
    terminal.end()
    assert terminal.status == 0


def test_ctrl_c_disarms_and_leaves(terminal: DrivenTerminal) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press("\x03")
    assert "interrupted" in terminal.end()
    assert terminal.status == 130


def test_without_a_terminal_it_says_so(ccr_host: CcrHost) -> None:
    ended = ccr_host("jog")
    assert ended.status == 2
    assert "not a terminal" in ended.err
