"""Fewer points of a curve than were recorded, without losing its peaks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def peak_rows(values: NDArray[np.float64], most: int) -> NDArray[np.intp]:
    """Indices of about ``most`` rows: the greatest of each stretch of equal length, and the newest.

    Args:
        values: (N,), without NaN.
        most: with no more rows than this, all are taken.
    """
    count = len(values)
    if count <= most:
        return np.arange(count)
    stretch = -(-count // most)
    starts = range(0, count, stretch)
    peaks = [start + int(values[start : start + stretch].argmax()) for start in starts]
    return np.union1d(peaks, [count - 1])
