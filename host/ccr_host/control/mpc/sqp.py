"""Sequential quadratic programming for the MPC's problem.

Each iteration minimises the second-order expansion within the bounds and backtracks along the
step. The exact Hessian is needed, since the residuals at the edge of the workspace are large and
Gauss-Newton stalls there; if it is not positive definite, it is blended with Gauss-Newton.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ccr_host.control.mpc.problem import Rollout, Tracking, expand, roll_out, squared
from ccr_host.control.mpc.qp import BOUND, FAILED, OPTIMAL, minimise
from ccr_host.core.arrays import Array
from ccr_host.robot.kinematics import products
from ccr_host.robot.workspace import MotorLimits

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
# After a Newton step that bends the robot by d the bending is off by about c d^2, so about (c d)^2
# of the decrease predicted for the step remains. c is the change of curvature with bending; along
# the paper's paths c^2 is about 0.3/rad^2, at the fold up to 13.
_LEFT_OVER_PER_RAD2 = 13.0


class Bounds(NamedTuple):
    """Bounds on the motor angles and on their change per step."""

    lower_rad: Array
    """(n,)."""
    upper_rad: Array
    """(n,)."""
    step_rad: float
    """Largest |u| of (15)."""

    @classmethod
    def of(cls, limits: MotorLimits, step_rad: float) -> Bounds:
        """The bounds given by motor limits and a step bound."""
        return cls(limits.lower_rad, limits.upper_rad, step_rad)


class Newton(NamedTuple):
    """A step to be tried."""

    changes_rad: Array
    """Changes of the angles, (M, n)."""
    predicted_reduction: float
    """Reduction of the cost predicted by the expansion."""
    blend: float


class Solution(NamedTuple):
    """The best rollout found, and how it was found."""

    status: int
    iterations: int
    rollout: Rollout


def feasible(bounds: Bounds, start_rad: Array, angles: Array) -> Array:
    """The angles, each changed as little as the bounds and its predecessor require.

    ``start_rad`` is within the limits.
    """
    lower, upper, reach = bounds
    inside = np.minimum(np.maximum(angles, lower), upper)
    far = np.abs(inside[1:] - inside[:-1]) > reach
    if far.any() or (np.abs(inside[0] - start_rad) > reach).any():
        last = start_rad
        for j in range(len(angles)):
            last = np.minimum(np.maximum(inside[j], last - reach), last + reach)
            inside[j] = last
    return inside


def room(bounds: Bounds, rollout: Rollout) -> tuple[Array, Array]:
    """Lower and upper bounds of a step from these angles, in the form of ``minimise``."""
    angles, moves = rollout.angles, rollout.moves_rad
    lower, upper = np.empty((2, *angles.shape)), np.empty((2, *angles.shape))
    lower[0], upper[0] = bounds.lower_rad - angles, bounds.upper_rad - angles
    lower[1], upper[1] = -bounds.step_rad - moves, bounds.step_rad - moves
    return lower, upper


def solve(problem: Tracking, bounds: Bounds, guess: Array, first: int = 1) -> Solution:
    """Descend from a feasible guess, (M, n), to a local minimum, from iteration ``first`` on.

    The status is CONVERGED or STOPPED with a feasible solution that costs no more than the guess,
    or says why there is no solution. Machine code ends with NEEDS_QP where a bound is active; from
    its angles and iteration on, ``solve`` as plain Python goes on.
    """
    rollout = roll_out(problem, guess)
    if not math.isfinite(rollout.cost):
        return Solution(COST_NOT_FINITE, 0, rollout)
    for iteration in range(first, MAX_ITERATIONS + 1):
        status, newton = _newton_step(problem, bounds, rollout)
        if status != CONVERGED:
            status = STOPPED if iteration > 1 and status != NEEDS_QP else status
            return Solution(status, iteration, rollout)
        is_over, rollout = line_search(problem, rollout, newton)
        if is_over:
            return Solution(CONVERGED, iteration, rollout)
    return Solution(STOPPED, MAX_ITERATIONS, rollout)


def line_search(problem: Tracking, rollout: Rollout, newton: Newton) -> tuple[bool, Rollout]:
    """Backtrack along a step until the cost decreases enough.

    Returns:
        Whether the iterations are over; the new rollout, or the old one if no step helps.
    """
    if newton.predicted_reduction <= _ROUNDING * rollout.cost:
        return True, rollout
    step_length = 1.0
    for _ in range(_MAX_HALVINGS):
        candidate = roll_out(problem, rollout.angles + step_length * newton.changes_rad)
        enough = _SUFFICIENT_DECREASE * step_length * newton.predicted_reduction
        if candidate.cost <= rollout.cost - enough:
            # Convergence is quadratic: the remainder after a full Newton step is known beforehand.
            size = squared(products(newton.changes_rad, problem.constants.chain.bending))
            left_over = newton.predicted_reduction * size * _LEFT_OVER_PER_RAD2
            is_newton = newton.blend == 1.0 and step_length == 1.0
            return is_newton and left_over <= _TOLERANCE * candidate.cost, candidate
        step_length *= 0.5
    # The decrease is below rounding errors: converged.
    return True, rollout


def _newton_step(problem: Tracking, bounds: Bounds, rollout: Rollout) -> tuple[int, Newton]:
    """Status (CONVERGED, NEEDS_QP or a failure), and the step."""
    expansion = expand(problem, rollout)
    lower, upper = room(bounds, rollout)
    for blend in BLENDS:
        ridge = 0.0 if blend > 0.0 else _RIDGE * squared(expansion.residuals)
        status, changes, minimum = minimise(expansion, blend, ridge, lower, upper)
        newton = Newton(changes, -minimum, blend)
        if status == OPTIMAL:
            return CONVERGED, newton
        if status == FAILED:
            return QP_FAILED, newton
        if status == BOUND:
            return NEEDS_QP, newton
    return HESSIAN_NOT_CONVEX, newton
