"""Shape of segment 1 at rest under gravity, for registration.

(10) bends a segment evenly. At rest the moment of its tendons is indeed even along it, but that of
the weight it carries falls off towards its end: theta'(s) = c + w X(s) along the segment, where s
and X (the distance from the base along the straight robot) count in segment lengths. c holds the
tendons, their slack and the lever of the load, whatever they are; with the bending angle measured
in each pose it is no unknown. Left is one number for all poses, the load
w = weight beyond the segment x length / bending stiffness (about 0.3 for the paper's robot).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_POINTS = 41
_SWEEPS = 3
"""Each sweep gains a factor of about ten; three are exact to 0.01 mm up to w = 1."""


def chord(bending_rad: FloatArray, load: float) -> ComplexArray:
    """From the start to the end of segments of unit length that bend by ``bending_rad``, (K,).

    Complex numbers in the bending plane: the real axis is the direction of the straight segment,
    the imaginary one points against gravity. Without load this is the unit arc of (10).
    """
    along = np.linspace(0.0, 1.0, _POINTS)
    even = bending_rad[:, None] * along
    angle = even
    for _ in range(_SWEEPS):
        curvature = load * _integral(np.cos(angle))
        uneven = _integral(curvature)
        angle = even + uneven - along * uneven[:, -1:]
    tangent: ComplexArray = np.exp(1j * angle)
    ends = 0.5 * (tangent[:, 0] + tangent[:, -1])
    # The trapezoid rule shortens an arc by theta^2 / (12 n^2), 0.03 % at 90 deg.
    total: ComplexArray = (tangent.sum(axis=1) - ends) / (_POINTS - 1)
    return total


def _integral(values: FloatArray) -> FloatArray:
    """Cumulative trapezoid rule along the last axis, from 0."""
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) / (_POINTS - 1)
    total = np.zeros_like(values)
    np.cumsum(steps, axis=1, out=total[:, 1:])
    return total
