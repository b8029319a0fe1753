"""What the board's setpoint was at a past time."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_KEPT = 64
_QUIET_RAD_S = 1.5
"""Paths turn the servos at a third of it; change-overs of tendons at five times."""
_JOLT_MEMORY_S = 0.3
"""Two oscillations of the structure."""


class SetpointHistory:
    """The last commands as straight ramps; times in s."""

    def __init__(self, q_rad: FloatArray) -> None:
        self._ramps: deque[tuple[float, float, FloatArray, FloatArray]] = deque(maxlen=_KEPT)
        self._jolts: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._initial_rad = q_rad

    def command(self, time_s: float, q_rad: FloatArray, ramp_s: float) -> None:
        """A command given at ``time_s``; it goes on from wherever the setpoint is."""
        before_rad = self.at(time_s)
        self._ramps.append((time_s, ramp_s, before_rad, q_rad))
        jolt_rad = float(np.abs(q_rad - before_rad).max()) - _QUIET_RAD_S * ramp_s
        if jolt_rad > 0.0:
            self._jolts.append((time_s, jolt_rad))

    def at(self, time_s: float) -> FloatArray:
        """Setpoint, (2,)."""
        for start_s, ramp_s, before_rad, after_rad in reversed(self._ramps):
            if start_s <= time_s:
                share = min((time_s - start_s) / ramp_s, 1.0)
                return before_rad + share * (after_rad - before_rad)
        return self._initial_rad

    def rate_at(self, time_s: float) -> FloatArray:
        """Its rate in rad/s, (2,)."""
        for start_s, ramp_s, before_rad, after_rad in reversed(self._ramps):
            if start_s <= time_s:
                moving = time_s < start_s + ramp_s
                return (after_rad - before_rad) / ramp_s * moving
        return np.zeros(2)

    def jolt_at(self, time_s: float) -> float:
        """By how much, in rad, servos have jumped lately: the structure still swings from it."""
        return sum(
            jolt_rad * math.exp((start_s - time_s) / _JOLT_MEMORY_S)
            for start_s, jolt_rad in self._jolts
            if start_s <= time_s
        )

    def corners(self, from_s: float, to_s: float) -> list[FloatArray]:
        """Setpoints where the ramps between two times begin, and at the later time, (2,) each."""
        begun = []
        for start_s, _, before_rad, _ in reversed(self._ramps):
            if start_s <= from_s:
                break
            if start_s < to_s:
                begun.append(before_rad)
        return [*reversed(begun), self.at(to_s)]

    def resting_since(self, time_s: float) -> float:
        """When the last motion before ``time_s`` ended; ``time_s`` itself during one."""
        for start_s, ramp_s, before_rad, after_rad in reversed(self._ramps):
            if start_s <= time_s and not np.array_equal(before_rad, after_rad):
                return min(start_s + ramp_s, time_s)
        return -np.inf
