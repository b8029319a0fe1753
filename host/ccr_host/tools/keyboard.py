"""Single keys from a terminal, without waiting."""

from __future__ import annotations

import os
import select
import sys
from contextlib import suppress
from typing import Self, TextIO

from ccr_host.core.errors import ConfigError

try:
    import termios
    import tty
except ModuleNotFoundError:  # on Windows
    _SUPPORTED = False
else:
    _SUPPORTED = True

ESCAPE = "\x1b"
UP, DOWN, RIGHT, LEFT = (f"{ESCAPE}[{letter}" for letter in "ABCD")
_CHUNK = 1024
_APPLICATION_MODE = "O"
"""Some terminals send ESC O A instead of ESC [ A for the arrow keys."""


class Keyboard:
    """Reads keys as they are pressed; a context manager.

    Args:
        stream: the terminal; None for standard input.

    Raises:
        ConfigError: not a terminal, or one that does not report single keys.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        stream = stream or sys.stdin  # None if the shell has closed it
        if stream is None or stream.closed or not stream.isatty():
            raise ConfigError("standard input is not a terminal", "start it from a terminal")
        if not _SUPPORTED:
            raise ConfigError("single keys cannot be read here", "use Linux, macOS or WSL")
        self._file = stream.fileno()

    def __enter__(self) -> Self:
        try:
            self._before = termios.tcgetattr(self._file)
            tty.setcbreak(self._file)
        except (termios.error, OSError) as error:
            raise ConfigError(
                f"the terminal does not report single keys ({error})",
                "start it from another terminal",
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(termios.error, OSError):  # the terminal may be gone
            termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[str]:
        """Keys since the last call; arrows as `UP` and so on.

        Raises:
            KeyboardInterrupt: the terminal is gone.
        """
        try:
            if not select.select([self._file], [], [], 0)[0]:
                return []
            data = os.read(self._file, _CHUNK)
        except (OSError, ValueError):
            raise KeyboardInterrupt from None
        if not data:
            raise KeyboardInterrupt
        return split_keys(data.decode("utf-8", errors="replace"))


def split_keys(text: str) -> list[str]:
    """Single characters, and escape sequences as a whole."""
    keys: list[str] = []
    rest = text
    while rest:
        length = _sequence_length(rest)
        keys.append(rest[:length].replace(f"{ESCAPE}{_APPLICATION_MODE}", f"{ESCAPE}["))
        rest = rest[length:]
    return keys


def _sequence_length(text: str) -> int:
    if not text.startswith((f"{ESCAPE}[", f"{ESCAPE}{_APPLICATION_MODE}")):
        return 1
    for index, letter in enumerate(text[2:], start=2):
        if letter.isalpha() or letter == "~":
            return index + 1
    return len(text)
