"""Which setpoint was in effect at a past time, and what it aimed at."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_KEPT_S = 2.0
"""Far above any camera's latency."""


class _Ramp(NamedTuple):
    start_s: float
    duration_s: float
    from_rad: FloatArray
    to_rad: FloatArray
    from_index: float | None
    to_index: float | None


class CommandLog:
    """The last commands as straight ramps; times in s."""

    def __init__(self, q_rad: FloatArray) -> None:
        self._initial_rad = q_rad
        self._ramps: deque[_Ramp] = deque()

    def command(self, time_s: float, q_rad: FloatArray, index: float | None, ramp_s: float) -> None:
        """A command given at ``time_s`` that aims at a step index of the path, or at none."""
        setpoint_rad, before = self.at(time_s)
        while len(self._ramps) > 1 and self._ramps[1].start_s < time_s - _KEPT_S:
            self._ramps.popleft()
        self._ramps.append(_Ramp(time_s, ramp_s, setpoint_rad, q_rad, before, index))

    def at(self, time_s: float) -> tuple[FloatArray, float | None]:
        """Setpoint (2,), and the step index it aimed at."""
        for ramp in reversed(self._ramps):
            if ramp.start_s <= time_s:
                share = min((time_s - ramp.start_s) / ramp.duration_s, 1.0)
                setpoint_rad = ramp.from_rad + share * (ramp.to_rad - ramp.from_rad)
                if ramp.from_index is None or ramp.to_index is None:
                    return setpoint_rad, ramp.to_index if share == 1.0 else None
                return setpoint_rad, ramp.from_index + share * (ramp.to_index - ramp.from_index)
        if not self._ramps:
            return self._initial_rad, None
        return self._ramps[0].from_rad, self._ramps[0].from_index
