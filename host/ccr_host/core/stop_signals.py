"""Signals that end a command, and sections in which they are deferred."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import current_thread, main_thread

_STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
"""SIGHUP does not exist on Windows."""


@dataclass
class _State:
    interrupted: bool = False
    interruptible_again: bool = False


_state = _State()


@contextmanager
def stop_signals_interrupt() -> Iterator[None]:
    """Make a closed terminal or SIGTERM end a command like Ctrl-C: the robot is made safe first.

    The first signal raises KeyboardInterrupt; if Python swallows that, the next one does. Further
    signals are ignored, so that the robot is left safe and the results are written, except inside
    `interruptible_again`. Signals that are already ignored stay so (nohup, background jobs of a
    shell). After the block all of them are ignored: only a message and the end of the process are
    left.
    """

    def interrupt(*_: object) -> None:
        if _state.interrupted and not _state.interruptible_again:
            return
        _state.interrupted = True
        raise KeyboardInterrupt

    def swallowed(unraisable: sys.UnraisableHookArgs) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            _state.interrupted = False  # raised in a finalizer or C callback: nothing was ended
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
def kill_interrupts() -> Iterator[None]:
    """A closed terminal or a polite kill raises KeyboardInterrupt, where it would end the process.

    Signals that the program handles or ignores itself are left alone, and all outside the main
    thread.
    """
    in_main_thread = current_thread() is main_thread()
    deadly = [n for n in _signals() if in_main_thread and signal.getsignal(n) == signal.SIG_DFL]
    for number in deadly:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in deadly:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def interruptible_again() -> Iterator[None]:
    """Let a signal interrupt this block even if one has interrupted before."""
    _state.interruptible_again = True
    try:
        yield
    finally:
        _state.interruptible_again = False


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Defer signals to the end of the block, so that something is written completely.

    Signals that are ignored, or that end the process at once, are not deferred.
    """
    in_main_thread = current_thread() is main_thread()  # the only one that receives signals
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


def cause_of_death(exit_code: int | None) -> str:
    """Why a process has ended, by the exit code that multiprocessing gives."""
    with suppress(ValueError):
        if exit_code is not None and exit_code < 0:
            return signal.Signals(-exit_code).name
    return f"exit code {exit_code}"


def _signals() -> list[signal.Signals]:
    return [getattr(signal, name) for name in _STOP_SIGNALS if hasattr(signal, name)]
