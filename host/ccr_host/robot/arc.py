"""The unit arc: end point of a backbone of length 1 that bends by theta.

The end point is the integral of the tangents, E(theta) = integral of exp(i theta s) over
s in [0, 1] = sin(theta)/theta + i (1 - cos(theta))/theta. E is entire, so the straight backbone
is a regular point. Everything in the paper's (10) and its derivatives follows from E, whose
derivatives obey theta E^(n) + n E^(n-1) = i^(n-1) exp(i theta). The recursion is solved upwards
away from zero, and downwards from the power series of E''' near it, so that nothing is divided by
a small angle.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.core.arrays import Number

SHORTER_BY_SAG = 2.0 / 3.0
"""A chain of n hinges is shorter than its arc by L theta^2 / (12 n^2), and its sag is
L / (8 n^2 r_c) radii per rad^2: the former is 2/3 r_c of the latter."""
LEAST_SOFTENED = 0.4
"""Least share of a segment's stiffness against uneven bending: below it, the model has buckled."""

# At 1 rad both directions are accurate to a few units in the last place.
_SERIES_BELOW_RAD = 1.0
_TERMS = 18
_THIRD_DERIVATIVE = [1j ** (3 + k) / (math.factorial(k) * (4 + k)) for k in range(_TERMS)]
# Odd powers make its real part, even powers its imaginary part; highest power first.
_SERIES_PAIRS = tuple(
    (_THIRD_DERIVATIVE[k + 1].real, _THIRD_DERIVATIVE[k].imag) for k in range(_TERMS - 2, -1, -2)
)


class Arc(NamedTuple):
    """The unit arc at an angle."""

    derivatives: tuple[Number, ...]
    """E, E', E'', E'''."""
    turn: Number
    """exp(i angle), the tangent at its end."""


def arc_at(theta_rad: Number) -> Arc:
    """The unit arc at one angle, or at an array of them; a float takes a tenth of the time."""
    return arc_at_one(theta_rad) if isinstance(theta_rad, float) else _arcs_at(theta_rad)


def arc_at_one(theta_rad: float) -> Arc:
    """The unit arc at one angle."""
    turn = cmath.exp(1j * theta_rad)
    if -_SERIES_BELOW_RAD < theta_rad < _SERIES_BELOW_RAD:
        return Arc(_downwards(theta_rad, turn), turn)
    return Arc(_upwards(theta_rad, turn), turn)


def _arcs_at(theta_rad: ArrayLike) -> Arc:
    theta = np.asarray(theta_rad, dtype=np.float64)
    small = np.abs(theta) < _SERIES_BELOW_RAD
    turn = np.exp(1j * theta)
    if small.all():
        return Arc(_downwards(theta, turn), turn)
    if not small.any():
        return Arc(_upwards(theta, turn), turn)
    away = _upwards(np.where(small, 1.0, theta), turn)
    near = _downwards(np.where(small, theta, 0.0), turn)
    return Arc(tuple(np.where(small, n, a) for n, a in zip(near, away, strict=True)), turn)


def doubled(half: Arc) -> Arc:
    """The unit arc at twice the angle: E(2 h) = E(h) (1 + exp(i h)) / 2."""
    turn = half.turn
    e0, e1, e2, e3 = half.derivatives
    whole, turned = 1.0 + turn, 1j * turn
    derivatives = (
        0.5 * (e0 * whole),
        0.25 * (e1 * whole + e0 * turned),
        0.125 * (e2 * whole + 2.0 * e1 * turned - e0 * turn),
        0.0625 * (e3 * whole + 3.0 * (e2 * turned - e1 * turn) - e0 * turned),
    )
    return Arc(derivatives, turn * turn)


def _upwards(theta: Number, turn: Number) -> tuple[Number, Number, Number, Number]:
    e0 = (turn - 1.0) / (1j * theta)
    e1 = (turn - e0) / theta
    e2 = (1j * turn - 2.0 * e1) / theta
    e3 = (-turn - 3.0 * e2) / theta
    return e0, e1, e2, e3


def _downwards(theta: Number, turn: Number) -> tuple[Number, Number, Number, Number]:
    square = theta * theta
    odd = even = 0.0 * square
    for of_odd, of_even in _SERIES_PAIRS:
        odd = odd * square + of_odd
        even = even * square + of_even
    e3 = theta * odd + 1j * even
    e2 = (-turn - theta * e3) / 3.0
    e1 = (1j * turn - theta * e2) / 2.0
    e0 = turn - theta * e1
    return e0, e1, e2, e3
