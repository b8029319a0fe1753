"""Signals that end a command."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

_STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Windows lacks the last one."""


@contextmanager
def stop_signals_interrupt() -> Iterator[None]:
    """A closed terminal or a polite kill ends a command like Ctrl-C: the robot is made safe first.

    Signals that are ignored already stay so (nohup, background jobs of a shell). Afterwards all of
    them are ignored: what is left is a message and the end of the process.
    """

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    numbers = [getattr(signal, name) for name in _STOP_SIGNALS if hasattr(signal, name)]
    heeded = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    for number in heeded:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, signal.SIG_IGN)
