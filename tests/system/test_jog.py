"""The command in a terminal that is driven."""

import re
from collections.abc import Iterator

import pexpect
import pytest

from tests.system.conftest import COMMAND, CcrHost

UP, LEFT = "\x1b[A", "\x1b[D"
_STYLING = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal:
    def __init__(self) -> None:
        self.process = pexpect.spawn(
            str(COMMAND), ["jog"], dimensions=(30, 110), timeout=20, encoding="utf-8"
        )

    def press(self, keys: str) -> None:
        self.process.send(keys)

    def wait_for(self, pattern: str) -> str:
        self.process.expect(pattern)
        return _STYLING.sub("", self.process.before + self.process.after)

    def end(self) -> str:
        self.process.expect(pexpect.EOF)
        self.process.close()
        return _STYLING.sub("", self.process.before)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    terminal.process.close(force=True)


def test_arrows_move_the_motors_on_the_board(terminal: Terminal) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press(UP + UP + LEFT)
    terminal.wait_for(r"motor 1 +2\.00 +2\.00 +1522\.0")
    terminal.wait_for(r"motor 2 +-1\.00 +-1\.00 +1489\.0")
    terminal.press("q")
    assert "disarmed" in terminal.end()
    assert terminal.process.exitstatus == 0


def test_the_stop_key_takes_the_pulses_away_and_another_key_arms_again(terminal: Terminal) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press(" ")
    stopped = terminal.wait_for("board: stopped; stopped by key")
    assert re.search(r"motor 1 .*none", stopped)
    terminal.press(UP)
    terminal.press("c")
    terminal.wait_for("board: hold|board: active")
    terminal.press("q")
    terminal.end()
    assert terminal.process.exitstatus == 0


def test_ctrl_c_disarms_and_leaves(terminal: Terminal) -> None:
    terminal.wait_for("board: hold|board: active")
    terminal.press("\x03")
    assert "interrupted" in terminal.end()
    assert terminal.process.exitstatus == 130


def test_without_a_terminal_it_says_so(ccr_host: CcrHost) -> None:
    ended = ccr_host("jog")
    assert ended.status == 2
    assert "not a terminal" in ended.err
