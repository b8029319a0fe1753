"""Plans a continuous sequence of bending angles along a path, with a globally optimal branch.

Beyond the fold of the workspace a point can be reached by two poses, or the nearest pose jumps from
one side to the other. All locally nearest poses of every sample are found; Viterbi's algorithm
selects one of each with minimum squared error plus a price of steps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.static_model import PathPlan
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.control.adaptive.tip import straight_tip_mm, tip_of
from ccr_host.core.arrays import (
    Array,
    Number,
    Two,
    largest,
    split,
    stacked,
    within,
)
from ccr_host.robot.workspace import MotorLimits, cheapest

Polish = Callable[[Parameters, Array, Array, int], Array]

_GRID_STEP_RAD = np.radians(5.0)
_MOST_BENDING_RAD = np.radians(200.0)
_CANDIDATES = 6
_STEP_PRICE_MM2_RAD2 = 4.0
"""A jump of half a radian costs as much as an error of 1 mm at one sample."""
_POLISHING_STEPS = 12
_DAMPING_MM2 = 150.0
"""More than the curvature due to an unreachable target at the fold: 3.5 mm times 40 mm/rad^2."""
_LONGEST_STEP_RAD = 0.1
_DONE_RAD = 1e-5
"""A micrometre. Each step was at most 0.36 of the one before near 200 random poses."""


class Atlas:
    """The tips on a grid of all bending angles that the motors can hold.

    The parameters are floats.
    """

    def __init__(self, p: Parameters, limits: MotorLimits) -> None:
        count = int(2 * _MOST_BENDING_RAD / _GRID_STEP_RAD) + 1
        axis = np.linspace(-_MOST_BENDING_RAD, _MOST_BENDING_RAD, count)
        self._p = p
        self._theta = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        q_rad = unhindered_setpoints_for(p, self._theta)
        allowed = np.all(limits.clip(q_rad) == q_rad, axis=-1, keepdims=True)
        self._tip_mm = np.where(allowed, straight_tip_mm(p, *split(self._theta)), np.inf)

    def nearest(self, target_mm: Array) -> tuple[Array, Array]:
        """Locally nearest poses of a target: angles (C, 2) and distances (C,), nearest first."""
        distance = np.linalg.norm(self._tip_mm - target_mm, axis=-1)
        inner = distance[1:-1, 1:-1]
        around = [
            distance[1 + i : distance.shape[0] - 1 + i, 1 + j : distance.shape[1] - 1 + j]
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
            if (i, j) != (0, 0)
        ]
        valley = np.isfinite(inner) & (inner <= np.minimum.reduce(around))
        found = np.argwhere(valley) + 1
        order = np.argsort(distance[found[:, 0], found[:, 1]])[:_CANDIDATES]
        start = self._theta[found[order, 0], found[order, 1]]
        return start, distance[found[order, 0], found[order, 1]]


def plan_path(
    p: Parameters,
    limits: MotorLimits,
    target_mm: Array,
    knots: Array,
    near: Array,
    polish: Polish,
) -> PathPlan:
    """Choose the branch and refine its poses.

    Args:
        p: parameters, floats.
        limits: of the motors.
        target_mm: desired tips at the knots, (K, 3), in the robot's frame.
        knots: step index of each, (K,).
        near: bending angles near which the plan should start, (2,).
        polish: ``polished``, plain or compiled.
    """
    atlas = Atlas(p, limits)
    candidates = [atlas.nearest(target) for target in target_mm]
    width = max(len(distance) for _, distance in candidates)
    theta = np.zeros((len(target_mm), width, 2))
    exists = np.zeros((len(target_mm), width), dtype=bool)
    for row, (angles, _) in enumerate(candidates):
        theta[row, : len(angles)] = angles
        exists[row, : len(angles)] = True
    targets = np.broadcast_to(target_mm[:, None], (*theta.shape[:2], 3))
    theta = polish(p, theta, targets, _POLISHING_STEPS)
    squared_mm2 = ((straight_tip_mm(p, *split(theta)) - targets) ** 2).sum(axis=-1)
    squared_mm2[~exists] = np.inf
    squared_mm2[0] += _STEP_PRICE_MM2_RAD2 * ((theta[0] - near) ** 2).sum(axis=-1)
    chosen = cheapest(theta, squared_mm2, _STEP_PRICE_MM2_RAD2)
    return PathPlan(knots, theta[np.arange(len(theta)), chosen])


def polished(p: Parameters, theta_rad: Array, target_mm: Array, iterations: int) -> Array:
    """Damped Gauss-Newton towards the nearest pose, from a start close by; (..., 2).

    Args:
        p: parameters, floats.
        theta_rad: bending angles to start from, (..., 2).
        target_mm: desired tips in the robot's frame, (..., 3).
        iterations: most steps to make.
    """
    theta_1, theta_2 = split(theta_rad)
    x_mm, y_mm, z_mm = split(target_mm)
    return stacked(*polished_of(p, theta_1, theta_2, x_mm, -y_mm + 1j * z_mm, iterations))


def polished_of(
    p: Parameters, theta_1: Number, theta_2: Number, x_mm: Number, wanted: Number, iterations: int
) -> Two:
    """``polished`` for a single pose; ``wanted`` is -y + i z of the target."""
    for _ in range(iterations):
        tip = tip_of(p, theta_1, theta_2)
        by_1, by_2 = tip.sagittal_1.conjugate(), tip.sagittal_2.conjugate()
        off = tip.sagittal - wanted
        off_x = tip.across - x_mm
        slope_1 = (by_1 * off).real + tip.across_1 * off_x
        slope_2 = (by_2 * off).real + tip.across_2 * off_x
        gram_11 = (by_1 * tip.sagittal_1).real + tip.across_1 * tip.across_1 + _DAMPING_MM2
        gram_12 = (by_1 * tip.sagittal_2).real + tip.across_1 * tip.across_2
        gram_22 = (by_2 * tip.sagittal_2).real + tip.across_2 * tip.across_2 + _DAMPING_MM2
        determinant = gram_11 * gram_22 - gram_12 * gram_12
        step_1 = (gram_12 * slope_2 - gram_22 * slope_1) / determinant
        step_2 = (gram_12 * slope_1 - gram_11 * slope_2) / determinant
        theta_1 = theta_1 + within(step_1, _LONGEST_STEP_RAD)
        theta_2 = theta_2 + within(step_2, _LONGEST_STEP_RAD)
        if largest(step_1) < _DONE_RAD and largest(step_2) < _DONE_RAD:
            break
    return theta_1, theta_2
