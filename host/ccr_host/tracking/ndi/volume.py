"""The volume in which a camera is accurate: a frustum that opens away from the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.tracking.frame import BoolArray

Pair = tuple[float, float]


@dataclass(frozen=True)
class MeasurementVolume:
    """Frustum along -z of the camera's frame; half widths are of x and y."""

    near_z_mm: float
    near_half_mm: Pair
    far_z_mm: float
    far_half_mm: Pair

    def contains(self, points_mm: ArrayLike) -> BoolArray:
        """Which of the points, (n, 3), lie inside or on the rim: (n,)."""
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
        depth = (points[:, 2] - self.near_z_mm) / (self.far_z_mm - self.near_z_mm)
        near, far = np.array(self.near_half_mm), np.array(self.far_half_mm)
        half_mm = near + depth[:, None] * (far - near)
        inside: BoolArray = (
            (depth >= 0) & (depth <= 1) & (np.abs(points[:, :2]) <= half_mm).all(axis=1)
        )
        return inside


VICRA = MeasurementVolume(
    near_z_mm=-557.0, near_half_mm=(196.0, 246.0), far_z_mm=-1336.0, far_half_mm=(443.5, 469.0)
)
"""Polaris Vicra: 392 x 491 mm at the near end, 887 x 938 mm at the far one. Depths and near end
are known, the far corners are the maker's figures as remembered: compare them with your manual."""
