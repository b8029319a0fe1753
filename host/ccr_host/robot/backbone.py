"""The shape of the robot as the markers show it.

Three markers do not determine a backbone. The curve drawn here passes where M2 and M3 say that the
two segments end, with the directions that the constant-curvature model needs to explain the
markers best; between them it is as smooth as an arc.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.robot.arc import arc_derivatives_at
from ccr_host.robot.kinematics import ConstantCurvature

FloatArray = NDArray[np.float64]

_CONVERGED = 1e-6
_STRAIGHT_RAD = 1e-6
"""Below it tan(x) / x is its limit, 1."""


def fitted_bending_rad(
    model: ConstantCurvature, markers_mm: FloatArray, start_rad: ArrayLike
) -> FloatArray:
    """Bending (theta_1, theta_2) that explains M2 and M3 best, least squares over both.

    Args:
        model: geometry.
        markers_mm: (3, 3), M1, M2, M3 in the frame of (10).
        start_rad: where to begin, (2,); the commanded bending is a good choice.
    """
    seen_mm = markers_mm - markers_mm[0]
    fit = least_squares(
        lambda theta: _marker_residuals(model, seen_mm, theta)[0],
        np.asarray(start_rad, dtype=np.float64),
        lambda theta: _marker_residuals(model, seen_mm, theta)[1],
        method="lm",
        xtol=_CONVERGED,
    )
    bending_rad: FloatArray = fit.x
    return bending_rad


def measured_backbone_mm(
    model: ConstantCurvature, markers_mm: FloatArray, bending_rad: FloatArray, points: int = 41
) -> FloatArray:
    """Curve through the segment ends that the markers show, (points, 3), origin M1."""
    theta_1, theta_2 = bending_rad
    offset_mm = model.marker_offset_mm * _marker_direction(theta_1)
    base = np.array((0.0, 0.0, -model.marker_offset_mm))
    middle = markers_mm[1] - markers_mm[0] - offset_mm
    tip = markers_mm[2] - markers_mm[0] - offset_mm
    start, bent, end = _tangent(0.0, 0.0), _tangent(theta_1, 0.0), _tangent(theta_1, theta_2)
    lengths = model.lengths_mm * np.array([_hermite_speed(theta_1), _hermite_speed(theta_2)])
    curve = CubicHermiteSpline([0.0, *np.cumsum(lengths)], [base, middle, tip], [start, bent, end])
    share = np.linspace(0.0, 1.0, points // 2 + 1)
    first, second = lengths[0] * share, lengths[0] + lengths[1] * share[1:]
    backbone_mm: FloatArray = curve(np.concatenate([first, second]))
    return backbone_mm


def marker_feet_mm(
    model: ConstantCurvature, markers_mm: FloatArray, bending_rad: FloatArray
) -> FloatArray:
    """Where the markers' stalks leave the backbone, (3, 3), origin M1."""
    offset_mm = model.marker_offset_mm * np.array(
        [_marker_direction(0.0), *2 * [_marker_direction(bending_rad[0])]]
    )
    feet_mm: FloatArray = markers_mm - markers_mm[0] - offset_mm
    return feet_mm


def disk_turns(bending_rad: FloatArray) -> FloatArray:
    """Orientation of the base and of each segment's last disk in the frame of (10), (3, 3, 3).

    The columns of each matrix are the disk's axes: z along the backbone, y towards its marker.
    """
    theta_1, theta_2 = bending_rad
    turns = []
    for first, second in ((0.0, 0.0), (theta_1, 0.0), (theta_1, theta_2)):
        along, up = _tangent(first, second), _marker_direction(first)
        turns.append(np.stack([np.cross(up, along), up, along], axis=1))
    return np.array(turns)


def turns_to(directions: FloatArray) -> FloatArray:
    """Quaternions (w, x, y, z) that turn the z axis along unit ``directions`` (N, 3) -> (N, 4)."""
    x, y, z = directions.T
    angles = np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)
    quaternions: FloatArray = Rotation.from_euler("ZY", angles).as_quat(scalar_first=True)
    return quaternions


def _marker_residuals(
    model: ConstantCurvature, seen_mm: FloatArray, theta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Expected minus seen coordinates of M2 and M3, and their derivatives, (5,) and (5, 2)."""
    length_1, length_2 = model.lengths_mm
    offset = 1j * model.marker_offset_mm
    arc_1, arc_1_slope, *_ = arc_derivatives_at(float(theta[0]))
    arc_2, arc_2_slope, *_ = arc_derivatives_at(float(theta[1]))
    turn = complex(math.cos(theta[0]), math.sin(theta[0]))
    marker_2 = length_1 * arc_1 + offset * (turn - 1)
    marker_3 = marker_2 + length_2 * arc_2.real * turn
    by_1_of_2 = length_1 * arc_1_slope + 1j * offset * turn
    by_1_of_3 = by_1_of_2 + 1j * length_2 * arc_2.real * turn
    by_2_of_3 = length_2 * arc_2_slope.real * turn
    miss_2 = marker_2 - complex(-seen_mm[1, 1], seen_mm[1, 2])
    miss_3 = marker_3 - complex(-seen_mm[2, 1], seen_mm[2, 2])
    across = length_2 * arc_2.imag - seen_mm[2, 0]
    return (
        np.array((miss_2.real, miss_2.imag, miss_3.real, miss_3.imag, across)),
        np.array(
            (
                (by_1_of_2.real, 0.0),
                (by_1_of_2.imag, 0.0),
                (by_1_of_3.real, by_2_of_3.real),
                (by_1_of_3.imag, by_2_of_3.imag),
                (0.0, length_2 * arc_2_slope.imag),
            )
        ),
    )


def _tangent(theta_1: float, theta_2: float) -> FloatArray:
    along = math.cos(theta_2)
    return np.array((math.sin(theta_2), -along * math.cos(theta_1), along * math.sin(theta_1)))


def _marker_direction(theta_1: float) -> FloatArray:
    """Unit vector from the backbone to a marker behind a bending of segment 1."""
    return np.array((0.0, math.sin(theta_1), math.cos(theta_1)))


def _hermite_speed(theta: float) -> float:
    """Tangent length over arc length with which a cubic follows an arc best."""
    quarter = min(abs(theta) / 4.0, 1.2)
    return math.tan(quarter) / quarter if quarter > _STRAIGHT_RAD else 1.0
