"""Units on the wire: angles in 0.01 deg, bytes of ten bits (8N1)."""

from __future__ import annotations

from collections.abc import Iterable
from math import radians

import numpy as np
from numpy.typing import NDArray

CDEG_PER_DEG = 100
_BITS_PER_BYTE = 10
_US_PER_S = 1_000_000


def deg_to_cdeg(angle_deg: float) -> int:
    """Angle in units of 0.01 deg, rounded to nearest."""
    return round(angle_deg * CDEG_PER_DEG)


def rad_to_cdeg(angles_rad: NDArray[np.float64]) -> list[int]:
    """Nearest 0.01 deg of each angle.

    Raises:
        ValueError: not a finite number.
    """
    cdeg: list[float] = np.rint(np.degrees(angles_rad) * CDEG_PER_DEG).tolist()
    try:
        return list(map(int, cdeg))
    except (ValueError, OverflowError):
        raise ValueError(f"angles of {angles_rad} rad cannot be sent") from None


def cdeg_to_rad(angles_cdeg: Iterable[int]) -> NDArray[np.float64]:
    """Angles of all axes, rad, (axes,), from units of 0.01 deg."""
    return np.array([radians(angle / CDEG_PER_DEG) for angle in angles_cdeg])


def wire_time_us(count: int, baud: int) -> int:
    """Transmission time of `count` bytes, us, rounded up."""
    return -(-count * _BITS_PER_BYTE * _US_PER_S // baud)


def bytes_in(time_us: int, baud: int) -> int:
    """Number of whole bytes transmitted in `time_us`."""
    return time_us * baud // (_BITS_PER_BYTE * _US_PER_S)
