"""What the board's setpoint was, and how fast it moved, at a past time."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.statics import Drive

FloatArray = NDArray[np.float64]

_KEPT = 64
_SIDE_TRAVEL_RAD = np.radians(1.0)
"""After so much travel in one direction play and friction count as taken up."""


class SetpointHistory:
    """The last commands as straight ramps; times in s."""

    def __init__(self, q_rad: FloatArray) -> None:
        self._ramps: deque[tuple[float, float, Drive, FloatArray]] = deque(maxlen=_KEPT)
        self._initial = Drive(q_rad, np.zeros(2))

    def command(self, time_s: float, q_rad: FloatArray, ramp_s: float) -> None:
        """A command given at ``time_s``; it goes on from wherever the setpoint is."""
        self._ramps.append((time_s, ramp_s, self.at(time_s)[0], q_rad))

    def at(self, time_s: float) -> tuple[Drive, FloatArray]:
        """Setpoint and side, and the setpoint's rate (2,)."""
        for start_s, ramp_s, before, after in reversed(self._ramps):
            if start_s <= time_s:
                share = min((time_s - start_s) / ramp_s, 1.0)
                travel = share * (after - before.setpoint_rad)
                side = np.clip(before.side + travel / _SIDE_TRAVEL_RAD, -1.0, 1.0)
                rate = (after - before.setpoint_rad) / ramp_s if share < 1.0 else np.zeros(2)
                return Drive(before.setpoint_rad + travel, side), rate
        return self._initial, np.zeros(2)

    def resting_since(self, time_s: float) -> float:
        """When the last motion before ``time_s`` ended; ``time_s`` itself during one."""
        for start_s, ramp_s, before, after in reversed(self._ramps):
            if start_s <= time_s and not np.array_equal(before.setpoint_rad, after):
                return min(start_s + ramp_s, time_s)
        return -np.inf
