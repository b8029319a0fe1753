"""The only source of time: virtual and stepped, or real.

Whoever waits calls :meth:`Clock.sleep_until_us`. While it waits, the clock lets the rest of the
world go on: in virtual time it *is* the world's time and moves the emulated board, the wire and the
twin forward, over stretches in which none of them has anything to do; in real time it lets them
catch up with the wall clock in short slices.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

T = TypeVar("T")


class Steppable(Protocol):
    """Part of the world that moves with the clock."""

    def advance_to(self, time_us: int) -> None:
        """Bring this part to ``time_us``, which never goes back."""


@runtime_checkable
class Foreseeing(Steppable, Protocol):
    """Part that knows until when moving it along in one step or in many comes to the same."""

    @property
    def next_turn_us(self) -> int:
        """When at the latest it has to be moved along next, provided that no other part moves.

        A time that has passed asks for a turn in every slice, ``NEVER_US`` for none at all.
        """


NEVER_US = 1 << 62


class Parts:
    """Parts of the world that move together, in the order in which they were attached."""

    def __init__(self) -> None:
        self._parts: list[Steppable] = []
        self._foreseeing: list[Foreseeing] = []

    def attach(self, part: Steppable) -> None:
        """Move ``part`` along from now on, too."""
        self._parts.append(part)
        if isinstance(part, Foreseeing):
            self._foreseeing.append(part)

    def advance_to(self, time_us: int) -> None:
        """Bring all of them to ``time_us``."""
        for part in self._parts:
            part.advance_to(time_us)

    @property
    def next_turn_us(self) -> int:
        """Earliest turn that one of them needs; 0, which has passed, if one cannot tell."""
        if len(self._foreseeing) < len(self._parts):
            return 0
        return min([part.next_turn_us for part in self._foreseeing], default=NEVER_US)


class Clock(Protocol):
    """Time in whole microseconds since the clock was made."""

    realtime: bool

    def now_us(self) -> int:
        """Current time."""

    def sleep_until_us(self, time_us: int) -> None:
        """Return at ``time_us`` or at once if that has passed; the world goes on meanwhile."""

    def idle(self) -> None:
        """Let a moment of real time pass; in virtual time the world stands still meanwhile."""

    def attach(self, part: Steppable) -> None:
        """Move ``part`` along from now on, after the parts attached before it."""

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        """The result of computing work, while the world goes on however long that takes.

        In virtual time computing takes no time. In real time another thread steps in when the work
        takes long: it moves the parts along and calls ``meanwhile`` every ``every_us``.

        Raises:
            BaseException: whatever the work raises, or, when that is done, what the parts or
                ``meanwhile`` have raised; after such an error they are left alone.
        """


_SLICE_US = 1000
"""The parts are moved along at least so often, so that none runs far ahead of the others; in
virtual time those that foresee their turns get them at multiples of it."""
_COMPUTING_SLICE_S = 0.02
"""Longer, as the world and the work take turns on one interpreter: a usual step ends before it."""
_MINDER_STAYS_SLICES = 100
"""Without work; it is started again when there is some."""
_IDLE_US = 20_000
"""Short for whoever waits for the end of a pause, and hardly any work."""
_LONGEST_STEP_US = 20_000
"""Shorter than anything that a board waits for."""


class VirtualClock:
    """Simulated time: moves only when somebody waits, then as fast as the world can be computed.

    A wait is cut into slices, counted from its beginning. Those before the next turn of any part
    are skipped; the parts see no other times than if they were moved along in every slice.

    Args:
        slice_us: longest step in which parts are moved along that do not foresee their turns.
    """

    realtime = False

    def __init__(self, slice_us: int = _SLICE_US) -> None:
        self._slice_us = slice_us
        self._now_us = 0
        self._parts = Parts()

    def now_us(self) -> int:
        return self._now_us

    def sleep_until_us(self, time_us: int) -> None:
        while self._now_us < time_us:
            self._now_us = min(self._now_us + self._until_next_turn_us(), time_us)
            self._parts.advance_to(self._now_us)

    def idle(self) -> None:
        time.sleep(_IDLE_US * 1e-6)

    def attach(self, part: Steppable) -> None:
        self._parts.attach(part)

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        return work()

    def _until_next_turn_us(self) -> int:
        """Whole slices, at least one."""
        slices = -((self._now_us - self._parts.next_turn_us) // self._slice_us)
        return max(slices, 1) * self._slice_us


class RealClock:
    """Wall-clock time, monotonic; goes on while the computer sleeps, as the board's does."""

    realtime = True

    def __init__(self) -> None:
        self._start_ns = _elapsed_ns()
        self._parts = Parts()
        self._turns = threading.Lock()
        self._work: _Work | None = None
        self._is_minded = False

    def now_us(self) -> int:
        return (_elapsed_ns() - self._start_ns) // 1000

    def sleep_until_us(self, time_us: int) -> None:
        while True:
            now_us = self.now_us()
            self._parts.advance_to(now_us)
            left_us = time_us - self.now_us()
            if left_us <= 0:
                return
            time.sleep(min(left_us, _SLICE_US) * 1e-6)

    def idle(self) -> None:
        self.sleep_until_us(self.now_us() + _IDLE_US)

    def attach(self, part: Steppable) -> None:
        self._parts.attach(part)

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        started = _Work(meanwhile, every_us, self.now_us())
        with self._turns:
            self._work = started
            if not self._is_minded:
                self._is_minded = True
                threading.Thread(target=self._mind, daemon=True).start()
        try:
            result = work()
        finally:
            with self._turns:
                self._work = None
        if started.error is not None:
            raise started.error
        return result

    def _mind(self) -> None:
        """Let the world go on beside work that takes long.

        Handing each step to a thread instead costs two changes of thread a step: on a busy machine
        5 % of the steps at 20 Hz were late, against 0.1 % when they are computed in place.
        """
        idle_slices = 0
        while idle_slices < _MINDER_STAYS_SLICES:
            time.sleep(_COMPUTING_SLICE_S)
            with self._turns:
                work, now_us = self._work, self.now_us()
                idle_slices = idle_slices + 1 if work is None else 0
                if work is not None and now_us - work.start_us >= _COMPUTING_SLICE_S * 1e6:
                    work.stand_in(self._parts, now_us)
                self._is_minded = idle_slices < _MINDER_STAYS_SLICES


@dataclass
class _Work:
    """What is being computed while the world goes on."""

    meanwhile: Callable[[], None]
    every_us: int
    start_us: int
    stood_in_us: int = 0
    error: BaseException | None = None

    def stand_in(self, parts: Parts, now_us: int) -> None:
        """Do what whoever computes would do if it were waiting."""
        if self.error is not None:
            return
        try:
            parts.advance_to(now_us)
            if now_us - max(self.start_us, self.stood_in_us) >= self.every_us:
                self.stood_in_us = now_us
                self.meanwhile()
        except BaseException as error:
            self.error = error


def _elapsed_ns() -> int:
    """Of a clock that counts the time asleep, where the system has one."""
    if sys.platform == "linux":
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    if sys.platform == "darwin":
        # There CLOCK_MONOTONIC counts it, which time.monotonic() does not read.
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    return time.monotonic_ns()


class LaggingClock(RealClock):
    """Real time for a simulation that looks often: what it was kept from doing it does later.

    Where the computer leaves too little time, this clock runs slow instead of letting seconds pass
    at once, in which those who are served had no chance to speak.
    """

    def __init__(self) -> None:
        super().__init__()
        self._looked_at_us = self._now_us = 0

    def now_us(self) -> int:
        real_us = super().now_us()
        self._now_us += min(real_us - self._looked_at_us, _LONGEST_STEP_US)
        self._looked_at_us = real_us
        return self._now_us


class Stopwatch:
    """Measures computing time; never used for control, which knows only the :class:`Clock`."""

    def __init__(self) -> None:
        self._start_ns = time.perf_counter_ns()

    def elapsed_us(self) -> float:
        """Since this stopwatch was made."""
        return (time.perf_counter_ns() - self._start_ns) / 1000


class CpuStopwatch:
    """Measures the CPU time of this thread: what something costs, however busy the machine is."""

    def __init__(self) -> None:
        self._start_ns = time.thread_time_ns()

    def elapsed_s(self) -> float:
        """Since this stopwatch was made."""
        return (time.thread_time_ns() - self._start_ns) * 1e-9
