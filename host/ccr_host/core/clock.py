"""The only source of time: virtual and stepped, or real.

All waiting goes through :meth:`Clock.sleep_until_us`, which also advances the simulated parts. In
virtual time the clock *is* the world's time: it advances the emulated board, the wire and the twin,
and skips stretches in which none of them has anything to do. In real time it lets them catch up
with the wall clock in short slices.
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
    """A simulated part that is advanced by the clock."""

    def advance_to(self, time_us: int) -> None:
        """Advance this part to ``time_us``, which never decreases."""


@runtime_checkable
class Foreseeing(Steppable, Protocol):
    """A part that knows until when it can be advanced in one step instead of many."""

    @property
    def next_turn_us(self) -> int:
        """Latest time at which it must be advanced next, provided that no other part changes.

        A time in the past requests a turn in every slice, ``NEVER_US`` none at all.
        """


@runtime_checkable
class ForeseesArrivals(Protocol):
    """A source that knows before which time it has nothing new."""

    @property
    def next_arrival_us(self) -> int:
        """Time before which nothing new arrives, if nothing is sent; in the past if unknown."""


NEVER_US = 1 << 62


class Parts:
    """Simulated parts that advance together, in the order in which they were attached."""

    def __init__(self) -> None:
        self._parts: list[Steppable] = []
        self._foreseeing: list[Foreseeing] = []

    def attach(self, part: Steppable) -> None:
        self._parts.append(part)
        if isinstance(part, Foreseeing):
            self._foreseeing.append(part)

    def advance_to(self, time_us: int) -> None:
        for part in self._parts:
            part.advance_to(time_us)

    @property
    def next_turn_us(self) -> int:
        """Earliest turn that any part needs; 0 (in the past) if one of them cannot tell."""
        if len(self._foreseeing) < len(self._parts):
            return 0
        return min([part.next_turn_us for part in self._foreseeing], default=NEVER_US)


class Clock(Protocol):
    """Time in whole microseconds since the clock was made."""

    realtime: bool

    def now_us(self) -> int:
        """Current time."""

    def sleep_until_us(self, time_us: int) -> None:
        """Wait until ``time_us`` while the parts advance; return at once if it has passed."""

    def idle(self) -> None:
        """Let a moment of real time pass; virtual time does not advance."""

    def attach(self, part: Steppable) -> None:
        """Advance ``part`` from now on, after the parts attached before it."""

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        """Return the result of ``work``; the parts keep advancing however long it takes.

        In virtual time computing takes no time. In real time another thread takes over when the
        work takes long: it advances the parts and calls ``meanwhile`` every ``every_us``.

        Raises:
            BaseException: whatever ``work`` raises; or, once it has finished, the error of a part
                or of ``meanwhile``, after which neither is called any more.
        """


_SLICE_US = 1000
"""Longest step of the parts, so that none runs far ahead of the others; in virtual time, parts that
foresee their turns get them at multiples of it."""
_COMPUTING_SLICE_S = 0.02
"""Longer, as parts and work share one interpreter: a normal step finishes within it."""
_MINDER_STAYS_SLICES = 100
"""The minder thread ends after this many slices without work; new work starts it again."""
_IDLE_US = 20_000
"""Short enough for a user waiting for a pause to end, long enough to cost hardly any CPU time."""
_LONGEST_STEP_US = 20_000
"""Shorter than every time-out of a board."""


class VirtualClock:
    """Simulated time: advances only during a wait, as fast as the parts can be computed.

    A wait is divided into slices, counted from its start. Slices before the next turn of any part
    are skipped; the result is the same as if the parts were advanced in every slice. Parts that do
    not foresee their turns make no longer step than ``slice_us``.
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
        """Time to the next turn, us, rounded up to whole slices, at least one."""
        slices = -((self._now_us - self._parts.next_turn_us) // self._slice_us)
        return max(slices, 1) * self._slice_us


class RealClock:
    """Monotonic wall-clock time; keeps counting while the computer sleeps, as the board's does."""

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
        """Keep the parts advancing while work takes long.

        Handing each step to a thread instead costs two thread switches a step: on a busy machine
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
    """A computation during which the parts keep advancing."""

    meanwhile: Callable[[], None]
    every_us: int
    start_us: int
    stood_in_us: int = 0
    error: BaseException | None = None

    def stand_in(self, parts: Parts, now_us: int) -> None:
        """Do what the computing thread would do if it were waiting."""
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
    """Time of a clock that includes system sleep, ns, where the system has one."""
    if sys.platform == "linux":
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    if sys.platform == "darwin":
        # CLOCK_MONOTONIC includes system sleep here, but time.monotonic() does not read it.
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    return time.monotonic_ns()


class LaggingClock(RealClock):
    """Real time for a simulation that polls often and catches up on missed time slowly.

    When the computer is too busy, this clock runs slow instead of jumping by seconds in which the
    clients of the simulation had no chance to send anything.
    """

    def __init__(self) -> None:
        super().__init__()
        self._looked_at_us = self._now_us = 0

    def now_us(self) -> int:
        real_us = super().now_us()
        self._now_us += min(real_us - self._looked_at_us, _LONGEST_STEP_US)
        self._looked_at_us = real_us
        return self._now_us


wall_ns = time.perf_counter_ns
"""Measures computing time; never used for control, which sees only the :class:`Clock`."""
cpu_ns = time.thread_time_ns
"""Measures the CPU time of this thread, independent of the load of the machine."""
