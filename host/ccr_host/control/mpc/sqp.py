"""Sequential quadratic programming for the MPC's problem.

Each iteration minimises the second-order expansion within the bounds and backtracks along the
step. The exact Hessian is needed, since the residuals at the edge of the workspace are large and
Gauss-Newton stalls there; if it is not positive definite, it is blended with Gauss-Newton.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.mpc.problem import Pair, Rollout, Tracking, expand, hessian, roll_out
from ccr_host.control.mpc.qp import BOUND, FAILED, OPTIMAL, minimise
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]

CONVERGED, STOPPED, COST_NOT_FINITE, HESSIAN_NOT_CONVEX, QP_FAILED, NEEDS_QP = 0, 1, 2, 3, 4, 5

MAX_ITERATIONS = 30
# Fractions of the exact curvature, tried in this order.
BLENDS = (1.0, 0.5, 0.1, 0.0)
# Keeps Gauss-Newton definite where J loses rank and R is 0; relative to its trace.
_RIDGE = 1e-10
_SUFFICIENT_DECREASE = 1e-4
_MAX_HALVINGS = 20
# Fractions of the cost: the decrease that may remain, and the size of rounding errors.
_TOLERANCE = 1e-8
_ROUNDING = 1e-14
# After a Newton step of size d the angles are off by about c d^2, so about (c d)^2 of the decrease
# predicted for the step remains. c is the change of curvature with angle; along the paper's paths
# c^2 is about 2/rad^2, at the fold up to 100.
_LEFT_OVER_PER_RAD2 = 100.0
# A placeholder: only machine code writes to it.
_NO_PROGRAM = np.empty((1, 0))


class Bounds(NamedTuple):
    """Bounds on the motor angles and on their change per step."""

    lower_rad: Pair
    upper_rad: Pair
    step_rad: float
    """Largest |u| of (15)."""

    @classmethod
    def of(cls, limits: MotorLimits, step_rad: float) -> Bounds:
        """The bounds given by motor limits and a step bound."""
        lower_1, lower_2 = limits.lower_rad.tolist()
        upper_1, upper_2 = limits.upper_rad.tolist()
        return cls((lower_1, lower_2), (upper_1, upper_2), step_rad)


class Newton(NamedTuple):
    """A step to be tried."""

    step_rad: FloatArray | list[float]
    """Changes of the angles, (2M,)."""
    predicted_reduction: float
    """Reduction of the cost predicted by the expansion."""
    blend: float


class Solution(NamedTuple):
    """The best rollout found, and how it was found."""

    status: int
    iterations: int
    rollout: Rollout
    blend: float
    """Fraction of the exact curvature in the last QP."""


def clip(bounds: Bounds, angles: Sequence[float]) -> Pair:
    """The nearest pair of motor angles within their limits."""
    (lower_1, lower_2), (upper_1, upper_2) = bounds.lower_rad, bounds.upper_rad
    return min(max(angles[0], lower_1), upper_1), min(max(angles[1], lower_2), upper_2)


def feasible(bounds: Bounds, start_rad: Pair, angles: list[Pair]) -> list[Pair]:
    """The angles, each changed as little as the bounds and its predecessor require.

    ``start_rad`` is within the limits.
    """
    (lower_1, lower_2), (upper_1, upper_2), reach = bounds
    inside: list[Pair] = []
    first, second = start_rad
    for angle_1, angle_2 in angles:
        first = min(max(angle_1, first - reach, lower_1), first + reach, upper_1)
        second = min(max(angle_2, second - reach, lower_2), second + reach, upper_2)
        inside.append((first, second))
    return inside


def room(bounds: Bounds, start_rad: Pair, angles: list[Pair]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds of a step from these angles, in the form of ``minimise``."""
    (lower_1, lower_2), (upper_1, upper_2), reach = bounds
    n = 2 * len(angles)
    lower, upper = np.empty(2 * n), np.empty(2 * n)
    last_1, last_2 = start_rad
    for j, (angle_1, angle_2) in enumerate(angles):
        first, second = 2 * j, 2 * j + 1
        lower[first], upper[first] = lower_1 - angle_1, upper_1 - angle_1
        lower[second], upper[second] = lower_2 - angle_2, upper_2 - angle_2
        move_1, move_2 = angle_1 - last_1, angle_2 - last_2
        lower[n + first], upper[n + first] = -reach - move_1, reach - move_1
        lower[n + second], upper[n + second] = -reach - move_2, reach - move_2
        last_1, last_2 = angle_1, angle_2
    return lower, upper


def solve(
    problem: Tracking, bounds: Bounds, guess: list[Pair], program: FloatArray = _NO_PROGRAM
) -> Solution:
    """Descend from a feasible guess of M pairs of motor angles to a local minimum.

    The status is CONVERGED or STOPPED with a feasible solution that costs no more than the guess,
    or says why there is no solution. Machine code ends with NEEDS_QP if a bound is active, and
    writes to ``program`` (2M + 1, 2M) the QP of the iteration, the gradient below the Hessian:
    its solution is the next ``Newton`` for ``line_search``.
    """
    rollout = roll_out(problem, guess)
    if not math.isfinite(rollout.cost):
        return Solution(COST_NOT_FINITE, 0, rollout, 0.0)
    return descend(problem, bounds, rollout, 1, program)


def descend(
    problem: Tracking, bounds: Bounds, rollout: Rollout, first: int, program: FloatArray
) -> Solution:
    """Run the iterations from number ``first``, see ``solve``."""
    for iteration in range(first, MAX_ITERATIONS + 1):
        status, newton = _newton_step(problem, bounds, rollout, program)
        if status != CONVERGED:
            status = STOPPED if iteration > 1 and status != NEEDS_QP else status
            return Solution(status, iteration, rollout, newton.blend)
        is_over, rollout = line_search(problem, rollout, newton)
        if is_over:
            return Solution(CONVERGED, iteration, rollout, newton.blend)
    return Solution(STOPPED, MAX_ITERATIONS, rollout, 0.0)


def line_search(problem: Tracking, rollout: Rollout, newton: Newton) -> tuple[bool, Rollout]:
    """Backtrack along a step until the cost decreases enough.

    Returns:
        Whether the iterations are over; the new rollout, or the old one if no step helps.
    """
    if newton.predicted_reduction <= _ROUNDING * rollout.cost:
        return True, rollout
    step, step_length = newton.step_rad, 1.0
    for _ in range(_MAX_HALVINGS):
        angles = rollout.angles.copy()
        for j in range(len(angles)):
            angle_1, angle_2 = angles[j]
            angles[j] = angle_1 + step_length * step[2 * j], angle_2 + step_length * step[2 * j + 1]
        candidate = roll_out(problem, angles)
        enough = _SUFFICIENT_DECREASE * step_length * newton.predicted_reduction
        if candidate.cost <= rollout.cost - enough:
            # Convergence is quadratic: the remainder after a full Newton step is known beforehand.
            squared = 0.0
            for angle in step:
                squared += angle * angle
            left_over = newton.predicted_reduction * squared * _LEFT_OVER_PER_RAD2
            is_newton = newton.blend == 1.0 and step_length == 1.0
            return is_newton and left_over <= _TOLERANCE * candidate.cost, candidate
        step_length *= 0.5
    # The decrease is below rounding errors: converged.
    return True, rollout


def _newton_step(
    problem: Tracking, bounds: Bounds, rollout: Rollout, program: FloatArray
) -> tuple[int, Newton]:
    """Status (CONVERGED, NEEDS_QP or a failure), and the step."""
    expansion = expand(problem, rollout)
    lower, upper = room(bounds, problem.start_rad, rollout.angles)
    gradient = expansion.gradient
    for blend in BLENDS:
        matrix = hessian(expansion, problem.weights.effort, blend, 0.0 if blend > 0.0 else _RIDGE)
        status, step, minimum = minimise(matrix, gradient, lower, upper)
        newton = Newton(step, -minimum, blend)
        if status == OPTIMAL:
            return CONVERGED, newton
        if status == FAILED:
            return QP_FAILED, newton
        if status == BOUND:
            program[:-1], program[-1] = matrix, gradient
            return NEEDS_QP, newton
    return HESSIAN_NOT_CONVEX, Newton(gradient, 0.0, 0.0)
