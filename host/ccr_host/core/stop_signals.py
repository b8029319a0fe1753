"""Signals that end a command, and moments in which they have to wait."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import current_thread, main_thread

_STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Windows lacks the last one."""


@dataclass
class _State:
    interrupted: bool = False
    interruptible_again: bool = False


_state = _State()


@contextmanager
def stop_signals_interrupt() -> Iterator[None]:
    """A closed terminal or a polite kill ends a command like Ctrl-C: the robot is made safe first.

    The first signal interrupts; where Python has to swallow that, the next one does. Further ones
    are ignored, so that the robot is left safe and the results are written, but for those who wait
    for one: see `interruptible_again`. Signals that are ignored already stay so (nohup, background
    jobs of a shell). Afterwards all of them are ignored: what is left is a message and the end of
    the process.
    """

    def interrupt(*_: object) -> None:
        if _state.interrupted and not _state.interruptible_again:
            return
        _state.interrupted = True
        raise KeyboardInterrupt

    def swallowed(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            _state.interrupted = False  # in a finalizer, or a callback of C: nothing has ended
        else:
            sys.__unraisablehook__(unraisable)

    sys.unraisablehook = swallowed
    heeded = [number for number in _signals() if signal.getsignal(number) != signal.SIG_IGN]
    for number in heeded:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def interruptible_again() -> Iterator[None]:
    """Here, a signal interrupts though one has done so already."""
    _state.interruptible_again = True
    try:
        yield
    finally:
        _state.interruptible_again = False


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Let something be written to the end: what would interrupt it does so afterwards.

    Signals that are ignored, or would end the process at once, do so as before.
    """
    in_main_thread = current_thread() is main_thread()  # no other gets signals
    before = {number: signal.getsignal(number) for number in _signals() if in_main_thread}
    deferred = {number: handler for number, handler in before.items() if callable(handler)}
    came: list[int] = []
    for number in deferred:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in deferred.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


def _signals() -> list[signal.Signals]:
    return [getattr(signal, name) for name in _STOP_SIGNALS if hasattr(signal, name)]
