"""Arithmetic for floats and arrays; on floats it is about ten times faster.

The model is written once with it: for floats (one robot), for arrays (many robots), and compiled
(`compiled.py`), where everything is a float.
"""

from __future__ import annotations

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.robot.arc import Number

Two = tuple[Number, Number]
Three = tuple[Number, Number, Number]
Six = tuple[Number, Number, Number, Number, Number, Number]


def split(rows: Array) -> tuple[Number, ...]:
    """The columns of (..., n), as floats if there is only one row."""
    if rows.ndim == 1:
        return tuple(rows.tolist())
    return tuple(np.moveaxis(rows, -1, 0))


def stacked(*columns: Number) -> Array:
    """The inverse of ``split``: stack columns to (..., n), broadcast against each other."""
    if all(isinstance(column, float) for column in columns):
        return np.array(columns)
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def positive(x: Number) -> Number:
    """max(x, 0)."""
    return 0.5 * (x + abs(x))


def sign(x: Number) -> Number:
    """1 or -1."""
    return 2.0 * (x > 0.0) - 1.0


def within(x: Number, most: float) -> Number:
    """x limited to the interval from -most to most."""
    return 0.5 * (abs(x + most) - abs(x - most))


def largest(x: Number) -> float:
    """The largest absolute value."""
    return abs(x) if isinstance(x, float) else float(np.abs(x).max())


def anywhere(x: Number) -> bool:
    """Whether a condition holds for any element."""
    return bool(np.any(x))
