"""Past setpoints of the motors, and the path steps that they aimed at."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ccr_host.core.arrays import Array

_KEPT_S = 2.0
"""Much longer than any camera's latency."""
_QUIET_RAD_S = 1.5
"""Three times the servo rate of paths, a fifth of that of tendon change-overs."""
_JOLT_MEMORY_S = 0.3
"""Two oscillations of the structure."""
_MOST_JOLTS = 64


class _Ramp(NamedTuple):
    start_s: float
    duration_s: float
    from_rad: Array
    to_rad: Array
    from_index: float | None
    to_index: float | None

    def share(self, time_s: float) -> float:
        if time_s >= self.start_s + self.duration_s:
            return 1.0
        return max(0.0, (time_s - self.start_s) / self.duration_s)


class SetpointHistory:
    """The last commands as linear ramps; times in s.

    ``q_rad``, (n,), is the setpoint before the first command, without a path step.
    """

    def __init__(self, q_rad: Array) -> None:
        self.restart(q_rad)

    def restart(self, q_rad: Array) -> None:
        """Clear the history, as if the setpoint had always been ``q_rad``, (n,)."""
        self._ramps = deque([_Ramp(-math.inf, 0.0, q_rad, q_rad, None, None)])
        self._jolts: deque[tuple[float, float]] = deque(maxlen=_MOST_JOLTS)

    def command(
        self, time_s: float, q_rad: Array, ramp_s: float, index: float | None = None
    ) -> None:
        """Add a command given at ``time_s``, which starts at the current setpoint.

        Args:
            time_s: time, not before that of the last command.
            q_rad: commanded motor angles, (n,).
            ramp_s: duration of the ramp.
            index: path step that it aims at, if any.
        """
        before_rad, before = self.at(time_s), self.index_at(time_s)
        while len(self._ramps) > 1 and self._ramps[1].start_s < time_s - _KEPT_S:
            self._ramps.popleft()
        self._ramps.append(_Ramp(time_s, ramp_s, before_rad, q_rad, before, index))
        jolt_rad = float(np.abs(q_rad - before_rad).max()) - _QUIET_RAD_S * ramp_s
        if jolt_rad > 0.0:
            self._jolts.append((time_s, jolt_rad))

    def at(self, time_s: float) -> Array:
        """Setpoint at ``time_s``, rad, (n,)."""
        ramp = self._ramp_at(time_s)
        share = ramp.share(time_s)
        return (
            ramp.to_rad if share == 1.0 else ramp.from_rad + share * (ramp.to_rad - ramp.from_rad)
        )

    def index_at(self, time_s: float) -> float | None:
        """Path step that the setpoint aimed at, interpolated; None if none."""
        ramp = self._ramp_at(time_s)
        share = ramp.share(time_s)
        if ramp.from_index is None or ramp.to_index is None:
            return ramp.to_index if share == 1.0 else None
        return ramp.from_index + share * (ramp.to_index - ramp.from_index)

    def rate_at(self, time_s: float) -> Array:
        """Rate of the setpoint, rad/s, (n,)."""
        ramp = self._ramp_at(time_s)
        if not 0.0 <= time_s - ramp.start_s < ramp.duration_s:
            return np.zeros(len(ramp.to_rad))
        return (ramp.to_rad - ramp.from_rad) / ramp.duration_s

    def jolt_at(self, time_s: float) -> float:
        """Decayed sum of recent servo jumps, rad, from which the structure still swings."""
        return sum(
            jolt_rad * math.exp((start_s - time_s) / _JOLT_MEMORY_S)
            for start_s, jolt_rad in self._jolts
            if start_s <= time_s
        )

    def corners(self, from_s: float, to_s: float) -> list[Array]:
        """Setpoints at the starts of the ramps between two times and at the end, (n,) each."""
        begun = [ramp.from_rad for ramp in self._ramps if from_s < ramp.start_s < to_s]
        return [*begun, self.at(to_s)]

    def resting_since(self, time_s: float) -> float:
        """End of the last motion before ``time_s``; ``time_s`` itself during a motion."""
        for ramp in reversed(self._ramps):
            if ramp.start_s <= time_s and not np.array_equal(ramp.from_rad, ramp.to_rad):
                return min(ramp.start_s + ramp.duration_s, time_s)
        return -math.inf

    def _ramp_at(self, time_s: float) -> _Ramp:
        begun = (ramp for ramp in reversed(self._ramps) if ramp.start_s <= time_s)
        return next(begun, self._ramps[0])
