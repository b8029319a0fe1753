"""Where the camera stands against the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.tracking.quaternion import quaternion

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]

IN_FRONT_MM: Vector3 = (0.0, 50.0, -900.0)
"""Puts a robot of 100 mm that hangs along -y into the middle of a Vicra's volume."""


@dataclass(frozen=True)
class Placement:
    """A camera turned by R against the robot's frame measures R^T p + t, as the twin's does."""

    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """Rotation vector of R."""
    base_mm: Vector3 = IN_FRONT_MM
    """t: the robot's origin in the camera's frame."""

    def quaternion(self) -> Array:
        """(4,): w, x, y, z of R^T."""
        return quaternion(-np.radians(self.rotation_deg))

    def to_camera(self, points_mm: Array) -> Array:
        """Points of the robot's frame, (n, 3), in the camera's."""
        w, *v = self.quaternion()
        vector = np.array(v)
        twice = 2 * np.cross(vector, points_mm)
        turned: Array = points_mm + w * twice + np.cross(vector, twice)
        turned += np.array(self.base_mm)
        return turned
