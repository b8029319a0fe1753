"""A command in a terminal whose keys are pressed and whose screen is read by a test."""

from __future__ import annotations

import os
import re
import termios
from pathlib import Path
from typing import Any

import pexpect
from pexpect.fdpexpect import fdspawn

from tests.patience import PATIENCE_S
from tests.system.warm_start import Prepared, Program, as_usual

UP, DOWN, RIGHT, LEFT = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D"
_ROWS_AND_COLUMNS = (40, 110)
_STYLING = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class DrivenTerminal:
    """A command in a new terminal.

    Args:
        folder: to run in.
        words: after the program's name.
        prepared: see `Program`.
        environment: beside that of the tests.
    """

    def __init__(
        self, folder: Path, *words: str, prepared: Prepared = as_usual, **environment: str
    ) -> None:
        keys, screen = os.openpty()
        termios.tcsetwinsize(screen, _ROWS_AND_COLUMNS)
        self._program = Program(
            words,
            folder,
            [screen],
            environment={"TERM": "xterm-256color"} | environment,
            prepared=prepared,
        )
        self._screen: Any = fdspawn(keys, timeout=PATIENCE_S, encoding="utf-8")

    def press(self, keys: str) -> None:
        self._screen.send(keys)

    def wait_for(self, pattern: str) -> str:
        """Output up to the end of a match."""
        self._screen.expect(pattern)
        return _STYLING.sub("", self._screen.before + self._screen.after)

    def end(self) -> str:
        """Output up to the end of the command."""
        return _STYLING.sub("", self.styled_end())

    def styled_end(self) -> str:
        """The same with the sequences that colour it and move the cursor."""
        self._screen.expect(pexpect.EOF)
        self._screen.close()
        self._program.wait(PATIENCE_S)
        return self._screen.before

    def hang_up(self) -> None:
        """Close the window, and wait until the command has ended."""
        self._screen.close()
        self._program.wait(PATIENCE_S)

    def kill(self) -> None:
        """End it as it is."""
        self._program.kill()
        self._screen.close()

    @property
    def status(self) -> int | None:
        """Exit status, once it has ended; negative: the signal that killed it."""
        return self._program.returncode
