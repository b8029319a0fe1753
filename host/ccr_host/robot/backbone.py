"""The shape of the robot as the markers show it.

A marker at the end of each segment does not determine a backbone. The curve drawn here passes where
the markers say that the segments end, with the directions that the constant-curvature model needs
to explain the markers best; between them it is as smooth as an arc.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.core.arrays import Array
from ccr_host.robot.kinematics import ConstantCurvature

_CONVERGED = 1e-6
_STRAIGHT_RAD = 1e-6
"""Below it tan(x) / x is its limit, 1."""
_MOST_QUARTER_RAD = 1.2


def fitted_bending_rad(model: ConstantCurvature, markers_mm: Array, start_rad: ArrayLike) -> Array:
    """Degrees of freedom, (D,), that explain the markers best, least squares over all.

    Args:
        model: geometry.
        markers_mm: (S + 1, 3), M1 and so on in the frame of (10).
        start_rad: where to begin, (D,); the commanded bending is a good choice.
    """
    seen_mm = markers_mm[1:] - markers_mm[0]
    fit = least_squares(
        lambda bending: (model.markers_mm(bending[None])[0][0] - seen_mm).ravel(),
        np.asarray(start_rad, dtype=np.float64),
        lambda bending: model.markers_mm(bending[None])[1][0].reshape(seen_mm.size, -1),
        method="lm",
        xtol=_CONVERGED,
    )
    bending_rad: Array = fit.x
    return bending_rad


def measured_backbone_mm(
    model: ConstantCurvature, markers_mm: Array, bending_rad: Array, points: int = 41
) -> Array:
    """Curve through the segment ends that the markers show, (points, 3), origin M1."""
    angles_rad = np.linalg.norm(model.bends_rad(bending_rad), axis=-1)
    lengths = model.lengths_mm * _hermite_speed(angles_rad)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    tangents = model.disk_turns(bending_rad)[:, :, 2]
    curve = CubicHermiteSpline(ends, marker_feet_mm(model, markers_mm, bending_rad), tangents)
    parts = np.array_split(np.arange(points - 1), len(lengths))
    along = [
        start + length * np.arange(len(part)) / len(part)
        for start, length, part in zip(ends[:-1], lengths, parts, strict=True)
    ]
    backbone_mm: Array = curve(np.concatenate([*along, ends[-1:]]))
    return backbone_mm


def marker_feet_mm(model: ConstantCurvature, markers_mm: Array, bending_rad: Array) -> Array:
    """Where the markers' stalks leave the backbone, (S + 1, 3), origin M1."""
    offsets_mm = model.marker_offset_mm * model.disk_turns(bending_rad)[:, :, 1]
    feet_mm: Array = markers_mm - markers_mm[0] - offsets_mm
    return feet_mm


def turns_to(directions: Array) -> Array:
    """Quaternions (w, x, y, z) that turn the z axis along unit ``directions`` (N, 3) -> (N, 4)."""
    x, y, z = directions.T
    angles = np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)
    quaternions: Array = Rotation.from_euler("ZY", angles).as_quat(scalar_first=True)
    return quaternions


def _hermite_speed(angle_rad: Array) -> Array:
    """Tangent length over arc length with which a cubic follows an arc best."""
    quarter = np.clip(angle_rad / 4.0, _STRAIGHT_RAD, _MOST_QUARTER_RAD)
    return np.tan(quarter) / quarter
