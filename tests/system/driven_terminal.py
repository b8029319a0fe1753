"""A command in a terminal whose keys are pressed and whose screen is read by a test."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pexpect

from tests.patience import PATIENCE_S
from tests.system.conftest import COMMAND

UP, DOWN, RIGHT, LEFT = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D"
_STYLING = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class DrivenTerminal:
    def __init__(self, folder: Path, *words: str, ignore_sighup: bool = False) -> None:
        self.process = pexpect.spawn(
            COMMAND,
            list(words),
            cwd=folder,
            env=os.environ | {"TERM": "xterm-256color"},
            dimensions=(40, 110),
            timeout=PATIENCE_S,
            encoding="utf-8",
            ignore_sighup=ignore_sighup,
        )

    def press(self, keys: str) -> None:
        self.process.send(keys)

    def wait_for(self, pattern: str) -> str:
        """Output up to the end of a match."""
        self.process.expect(pattern)
        return _STYLING.sub("", self.process.before + self.process.after)

    def end(self) -> str:
        """Output up to the end of the command."""
        self.process.expect(pexpect.EOF)
        self.process.close()
        return _STYLING.sub("", self.process.before)

    @property
    def status(self) -> int:
        return self.process.exitstatus
