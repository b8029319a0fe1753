"""What the setpoints of the motors were at a past time, and what they aimed at."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_KEPT_S = 2.0
"""Far above any camera's latency."""
_QUIET_RAD_S = 1.5
"""Paths turn the servos at a third of it; change-overs of tendons at five times."""
_JOLT_MEMORY_S = 0.3
"""Two oscillations of the structure."""
_MOST_JOLTS = 64


class _Ramp(NamedTuple):
    start_s: float
    duration_s: float
    from_rad: FloatArray
    to_rad: FloatArray
    from_index: float | None
    to_index: float | None

    def share(self, time_s: float) -> float:
        if time_s >= self.start_s + self.duration_s:
            return 1.0
        return max(0.0, (time_s - self.start_s) / self.duration_s)


class SetpointHistory:
    """The last commands as straight ramps; times in s.

    Args:
        q_rad: setpoint before the first command, (2,); it aims at nothing.
    """

    def __init__(self, q_rad: FloatArray) -> None:
        self.restart(q_rad)

    def restart(self, q_rad: FloatArray) -> None:
        """Forget everything but a setpoint that has stood for ever, (2,)."""
        self._ramps = deque([_Ramp(-math.inf, 0.0, q_rad, q_rad, None, None)])
        self._jolts: deque[tuple[float, float]] = deque(maxlen=_MOST_JOLTS)

    def command(
        self, time_s: float, q_rad: FloatArray, ramp_s: float, index: float | None = None
    ) -> None:
        """A command given at ``time_s``; it goes on from wherever the setpoint is.

        Args:
            time_s: not before that of the last command.
            q_rad: where to, (2,).
            ramp_s: how long the setpoint takes.
            index: step of a path that it aims at, if it does.
        """
        before_rad, before = self.at(time_s), self.index_at(time_s)
        while len(self._ramps) > 1 and self._ramps[1].start_s < time_s - _KEPT_S:
            self._ramps.popleft()
        self._ramps.append(_Ramp(time_s, ramp_s, before_rad, q_rad, before, index))
        jolt_rad = float(np.abs(q_rad - before_rad).max()) - _QUIET_RAD_S * ramp_s
        if jolt_rad > 0.0:
            self._jolts.append((time_s, jolt_rad))

    def at(self, time_s: float) -> FloatArray:
        """Setpoint, (2,)."""
        ramp = self._ramp_at(time_s)
        share = ramp.share(time_s)
        return (
            ramp.to_rad if share == 1.0 else ramp.from_rad + share * (ramp.to_rad - ramp.from_rad)
        )

    def index_at(self, time_s: float) -> float | None:
        """Step of the path that the setpoint aimed at."""
        ramp = self._ramp_at(time_s)
        share = ramp.share(time_s)
        if ramp.from_index is None or ramp.to_index is None:
            return ramp.to_index if share == 1.0 else None
        return ramp.from_index + share * (ramp.to_index - ramp.from_index)

    def rate_at(self, time_s: float) -> FloatArray:
        """Rate of the setpoint in rad/s, (2,)."""
        ramp = self._ramp_at(time_s)
        if not 0.0 <= time_s - ramp.start_s < ramp.duration_s:
            return np.zeros(2)
        return (ramp.to_rad - ramp.from_rad) / ramp.duration_s

    def jolt_at(self, time_s: float) -> float:
        """By how much, in rad, servos have jumped lately: the structure still swings from it."""
        return sum(
            jolt_rad * math.exp((start_s - time_s) / _JOLT_MEMORY_S)
            for start_s, jolt_rad in self._jolts
            if start_s <= time_s
        )

    def corners(self, from_s: float, to_s: float) -> list[FloatArray]:
        """Setpoints where the ramps between two times begin, and at the later time, (2,) each."""
        begun = [ramp.from_rad for ramp in self._ramps if from_s < ramp.start_s < to_s]
        return [*begun, self.at(to_s)]

    def resting_since(self, time_s: float) -> float:
        """When the last motion before ``time_s`` ended; ``time_s`` itself during one."""
        for ramp in reversed(self._ramps):
            if ramp.start_s <= time_s and not np.array_equal(ramp.from_rad, ramp.to_rad):
                return min(ramp.start_s + ramp.duration_s, time_s)
        return -math.inf

    def _ramp_at(self, time_s: float) -> _Ramp:
        begun = (ramp for ramp in reversed(self._ramps) if ramp.start_s <= time_s)
        return next(begun, self._ramps[0])
