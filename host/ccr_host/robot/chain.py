"""Constant-curvature kinematics of any chain of segments, planar or spatial.

A segment bends evenly by the vector b = (b_x, b_y), the angle |b| towards b in the frame of its
first disk, whose z axis is the backbone's tangent. With x = |b|^2 and

    c_k(x) = integral of (1 - s)^(k-1) / (k-1)! cos(|b| s) over s in [0, 1],

so c_1 = sin|b| / |b| and c_2 = (1 - cos|b|) / |b|^2, its end is at L (c_2 b_x, c_2 b_y, c_1) and
its last disk is turned by I + c_1 W + c_2 W^2 with W the cross product with (-b_y, b_x, 0): the
frame is carried along without twist. The c_k are entire, dc_1/dx = (c_3 - c_2) / 2 and
dc_2/dx = c_4 - c_3 / 2, and they follow from the unit arc of ``arc``, so the straight segment is a
regular point and nothing is divided by a bending angle.

The paper's robot, (1)-(12), is two segments that bend along y and along x of this frame, see
``PAPER_FRAME``. ``kinematics`` keeps its form with complex numbers for the third derivatives of the
controllers; both are equal to rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccr_host.robot.arc import arc_derivatives

FloatArray = NDArray[np.float64]

PAPER_FRAME = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Vector of the chain's first frame to the frame of (10): its backbone starts along -y, segment 1
bends to +z, which is y of the chain, and segment 2 to +x."""


class Bend(NamedTuple):
    """One segment's shape and its derivatives by b_x and b_y, which come last but two or one."""

    end: FloatArray
    """End of a segment of length 1, (..., 3)."""
    end_by: FloatArray
    """(..., 2, 3)."""
    turn: FloatArray
    """Rotation from the frame of the last disk to that of the first, (..., 3, 3)."""
    turn_by: FloatArray
    """(..., 2, 3, 3)."""


def bend_of(bend_rad: ArrayLike) -> Bend:
    """Shape of a segment at bending vectors, (..., 2)."""
    b = np.asarray(bend_rad, dtype=np.float64)
    x, y = b[..., 0], b[..., 1]
    e0, e1, e2, e3 = arc_derivatives(np.hypot(x, y))
    c1 = e0.real
    c2 = e0.real - e1.imag
    c3 = (e0.real - 2.0 * e1.imag - e2.real) / 2.0
    c4 = (e0.real - 3.0 * e1.imag - 3.0 * e2.real + e3.imag) / 6.0
    by_1, by_2 = c3 - c2, 2.0 * c4 - c3
    zero, one = np.zeros_like(x), np.ones_like(x)
    end = np.stack([c2 * x, c2 * y, c1], axis=-1)
    turn = _matrix(
        (1.0 - c2 * x * x, -c2 * x * y, c1 * x),
        (-c2 * x * y, 1.0 - c2 * y * y, c1 * y),
        (-c1 * x, -c1 * y, 1.0 - c2 * (x * x + y * y)),
    )
    ends_by, turns_by = [], []
    for to, dx, dy in ((x, one, zero), (y, zero, one)):
        c1_by, c2_by = to * by_1, to * by_2
        ends_by.append(np.stack([c2_by * x + c2 * dx, c2_by * y + c2 * dy, c1_by], axis=-1))
        xx_by = c2_by * x * x + 2.0 * c2 * x * dx
        xy_by = c2_by * x * y + c2 * (dx * y + x * dy)
        yy_by = c2_by * y * y + 2.0 * c2 * y * dy
        sx_by, sy_by = c1_by * x + c1 * dx, c1_by * y + c1 * dy
        turns_by.append(
            _matrix(
                (-xx_by, -xy_by, sx_by), (-xy_by, -yy_by, sy_by), (-sx_by, -sy_by, -xx_by - yy_by)
            )
        )
    return Bend(end, np.stack(ends_by, axis=-2), turn, np.stack(turns_by, axis=-3))


def _matrix(*rows: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Weights(NamedTuple):
    """Which points of a chain are added up, and how often each."""

    at_end: FloatArray
    """Weight of the end of each segment, (S,)."""
    along: FloatArray
    """Weight spread evenly along each segment, (S,)."""
    tip_offset_mm: FloatArray
    """Added in the frame of the last disk, (3,)."""


def tip_weights(segments: int, tip_offset_mm: ArrayLike = (0.0, 0.0, 0.0)) -> Weights:
    """Weights with which the sum of points is the tip."""
    at_end = np.zeros(segments)
    at_end[-1] = 1.0
    return Weights(at_end, np.zeros(segments), np.asarray(tip_offset_mm, dtype=np.float64))


def point_mm(
    lengths_mm: ArrayLike, bend_rad: ArrayLike, weights: Weights
) -> tuple[FloatArray, FloatArray]:
    """Weighted sum of points of a chain in the frame of its base, and its derivatives.

    With ``tip_weights`` it is the tip; with weights in N it is what gravity's energy depends on. A
    weight along a segment acts at the mean of its points, by Simpson's rule.

    Args:
        lengths_mm: length of each segment, (S,).
        bend_rad: bending vectors, (..., S, 2), each in the frame in which its segment begins.
        weights: the points.

    Returns:
        The sum, (..., 3), and its derivatives, (..., S, 2, 3).
    """
    lengths = np.asarray(lengths_mm, dtype=np.float64)
    bends = np.asarray(bend_rad, dtype=np.float64)
    shape = bends.shape[:-2]
    beyond = np.broadcast_to(weights.tip_offset_mm, (*shape, 3))
    carried = 0.0
    by = np.empty((*bends.shape, 3))
    for number in reversed(range(len(lengths))):
        length, along = lengths[number], weights.along[number]
        carried = carried + weights.at_end[number]
        here = bend_of(bends[..., number, :])
        share = length * (carried + along / 6.0)
        sum_here = share * here.end
        slope = share * here.end_by
        if along:
            half = bend_of(0.5 * bends[..., number, :])
            sum_here = sum_here + along * length / 3.0 * half.end
            slope = slope + along * length / 6.0 * half.end_by
        by[..., number + 1 :, :, :] = np.einsum(
            "...ij,...sdj->...sdi", here.turn, by[..., number + 1 :, :, :]
        )
        by[..., number, :, :] = slope + np.einsum("...dij,...j->...di", here.turn_by, beyond)
        beyond = sum_here + np.einsum("...ij,...j->...i", here.turn, beyond)
        carried = carried + along
    return beyond, by
