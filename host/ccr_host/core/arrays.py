"""Arrays by the type of their elements, and arithmetic for floats and arrays alike.

The paper's robot has one text of its model for floats (one robot, ten times faster), for arrays
(many robots) and for machine code, where everything is a float.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.signedinteger[Any]]
BoolArray = NDArray[np.bool_]

Number = Any
"""A float, a complex number, or an array of them: the same code serves one and many."""
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
