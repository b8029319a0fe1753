"""Units on the wire: angles in 0.01 deg, bytes of ten bits (8N1)."""

from __future__ import annotations

from collections.abc import Iterable
from math import degrees, isfinite, radians

import numpy as np
from numpy.typing import NDArray

CDEG_PER_DEG = 100
_BITS_PER_BYTE = 10
_US_PER_S = 1_000_000


def deg_to_cdeg(angle_deg: float) -> int:
    """Angle in units of 0.01 deg, rounded to nearest."""
    return round(angle_deg * CDEG_PER_DEG)


def rad_to_cdeg(angle_rad: float) -> int:
    """Angle in units of 0.01 deg, rounded to nearest.

    Raises:
        ValueError: the angle is not finite.
    """
    if not isfinite(angle_rad):
        raise ValueError(f"an angle of {angle_rad} rad cannot be sent")
    return deg_to_cdeg(degrees(angle_rad))


def cdeg_to_rad(angles_cdeg: Iterable[int]) -> NDArray[np.float64]:
    """Angles of all axes, rad, (axes,), from units of 0.01 deg."""
    return np.array([radians(angle / CDEG_PER_DEG) for angle in angles_cdeg])


def wire_time_us(count: int, baud: int) -> int:
    """Transmission time of `count` bytes, us, rounded up."""
    return -(-count * _BITS_PER_BYTE * _US_PER_S // baud)


def bytes_in(time_us: int, baud: int) -> int:
    """Number of whole bytes transmitted in `time_us`."""
    return time_us * baud // (_BITS_PER_BYTE * _US_PER_S)
