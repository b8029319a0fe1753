"""A tendon-driven segment at rest, bent in a plane, whose curvature varies along it.

(10) bends a segment evenly. A real one is bent more at one end than at the other by

- its load: the moment of a weight falls off towards the end;
- a taper of its stiffness;
- friction: a tendon that is pulled loses a share of its tension at each hole around which it is
  bent, so the end is bent less; a tendon that is released has kept it, so the end is bent more;
- sag: between holes a tendon is straight, so its lever grows with the bending.

The tendons' moment is no unknown where the bending angle is measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, trapezoid

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_OWN_WEIGHT = 0.47
"""Weight of the segment over that beyond it, and the distance of that from the segment's end, in
lengths of the segment, for a robot like the paper's (shares of `control.adaptive.parameters`)."""
_LEVER = 0.45
_POINTS = 41
_MOST = 8.0
"""Bound of friction and lever, for trials far from any robot."""
_SWEEPS = 5
"""Each gains a factor of ten or so at the usual loads."""


class UnevenArc(NamedTuple):
    """What makes a segment bend unevenly; lengths count in lengths of the segment."""

    load: complex
    """Weight beyond the segment x length / bending stiffness: real part along the straight
    segment, towards its end; imaginary part against the side on which positive angles bend it."""
    taper: float
    """Share by which it is softer at its end than at its start."""
    friction: Array
    """(K,): coefficient of friction of the tendons, times the sign of the bending's last change."""
    sag: float
    """Share by which a bending of 0.5 rad lengthens the lever of the tendon that bends it."""


def chord(bending_rad: Array, arc: UnevenArc) -> tuple[ComplexArray, Array]:
    """Vectors from start to end of segments of unit length, and the moments of their tendons.

    With angle theta, position r, and stiffness 1 at the middle, s and r in segment lengths,

        theta'(s) = (1 + taper (s - 1/2)) (m f(s) + w(s)),    theta(0) = 0, theta(1) = bending,

    where m is the moment of the tendons, f = exp(-/+ mu |bent|) (1 + 2 sag |theta'|) their friction
    and lever, and w the moment of the weight beyond s. It is solved by iteration from the even arc.

    Args:
        bending_rad: angle between the tangents at both ends, (K,).
        arc: what bends them unevenly.

    Returns:
        Complex numbers in the bending plane, (K,): the real axis is the tangent at the start, the
        imaginary one the side to which positive angles bend. And m, (K,), in rad: positive for
        the tendon that bends to that side.
    """
    along = np.linspace(0.0, 1.0, _POINTS)
    flexible = 1.0 + arc.taper * (along - 0.5)
    angle = bending_rad[:, None] * along
    beyond = _LEVER * np.exp(1j * bending_rad)[:, None]
    moment = np.zeros_like(bending_rad)
    for _ in range(_SWEEPS):
        side = np.sign(moment)[:, None]
        carried = (1.0 + _OWN_WEIGHT * (1.0 - along)) * np.exp(1j * angle)
        arm = cumulative_trapezoid(carried, along, initial=0.0)
        arm = arm[:, -1:] - arm + beyond
        weight = -arc.load.imag * arm.real - arc.load.real * arm.imag
        bends = np.gradient(angle, along, axis=1)
        bent = cumulative_trapezoid(np.abs(bends), along, initial=0.0)
        tension = np.exp(-arc.friction[:, None] * side * bent)
        lever = 1.0 + 2.0 * arc.sag * side * bends
        pull = np.clip(tension * lever, 1.0 / _MOST, _MOST)
        by_weight = cumulative_trapezoid(flexible * weight, along, initial=0.0)
        by_tendons = cumulative_trapezoid(flexible * pull, along, initial=0.0)
        moment = (bending_rad - by_weight[:, -1]) / by_tendons[:, -1]
        angle = moment[:, None] * by_tendons + by_weight
    # The trapezoid rule shortens an arc by theta^2 / (12 n^2), 0.03 % at 90 deg.
    total: ComplexArray = trapezoid(np.exp(1j * angle), along)
    return total, moment
