"""Unit quaternions, as trackers report rotations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def quaternion(rotation_rad: ArrayLike) -> NDArray[np.float64]:
    """(4,): w, x, y, z of a rotation vector, (3,); w is not negative up to half a turn."""
    vector = np.asarray(rotation_rad, dtype=np.float64)
    half_angle = float(np.linalg.norm(vector)) / 2
    half_sinc = 0.5 * float(np.sinc(half_angle / math.pi))  # without 0/0
    return np.array([math.cos(half_angle), *(half_sinc * vector)])
