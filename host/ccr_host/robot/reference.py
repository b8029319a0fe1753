"""What a controller is asked to follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

REACHABLE_MM = 0.01
"""Nearer than this a point counts as reachable: far above rounding (1e-12 mm), far below what
the robot can show (half a microsecond of servo pulse moves the tip 0.1 mm, the camera's noise is
0.25 mm)."""


@dataclass(frozen=True)
class Reference:
    """A desired path, one sample per control period.

    ``time_s`` (N,) starts at 0. ``target_mm`` (N, 3) is the desired tip in the frame of (10): the
    path's own lateral coordinates f[0] and f[2] even where they cannot be reached. ``q_rad``
    (N, 2) are the nearest reachable motor angles, ``unavoidable_mm`` (N,) the lateral distance
    that remains there according to the model.
    """

    name: str
    period_s: float
    time_s: FloatArray
    target_mm: FloatArray
    q_rad: FloatArray
    unavoidable_mm: FloatArray

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Which samples the model can reach, (N,)."""
        return self.unavoidable_mm <= REACHABLE_MM

    @property
    def unreachable_steps(self) -> int:
        """Number of samples that cannot be reached."""
        return int(np.count_nonzero(~self.reachable))

    @property
    def floor_mean_mm(self) -> float:
        """Mean error that no motor angles can avoid, according to the model."""
        return float(np.mean(self.unavoidable_mm))
