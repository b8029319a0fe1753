"""Sequential quadratic programming for the MPC's problem.

Each iteration minimises the second-order expansion within the bounds and backtracks along the
step. The exact Hessian is needed, since the residuals at the edge of the workspace are large and
Gauss-Newton stalls there; where it is not positive definite it is blended with Gauss-Newton.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.box_qp import NotConvexError, QpError, solve_box_qp
from ccr_host.control.nlp import Angles, Expansion, Rollout, Tracking, expand, roll_out

FloatArray = NDArray[np.float64]

MAX_ITERATIONS = 30
# Share of the exact curvature that is tried, in turn.
_BLENDS = (1.0, 0.5, 0.1, 0.0)
# Keeps Gauss-Newton definite where J loses rank and R is 0; relative to its trace.
_RIDGE = 1e-10
_SUFFICIENT_DECREASE = 1e-4
_MAX_HALVINGS = 20
# Of the cost: what may be left on the table, and what is lost in rounding anyway.
_TOLERANCE = 1e-8
_ROUNDING = 1e-14
# After a Newton step of size d the angles are off by about c d^2, so about (c d)^2 of the decrease
# that the step promised is left. c is the change of curvature with angle; along the paper's paths
# c^2 is about 2/rad^2, at the fold up to 100.
_LEFT_OVER_PER_RAD2 = 100.0


class SolverError(Exception):
    """No step could be computed; says why."""


class Bounds:
    """On the motor angles and on their change per step.

    Args:
        lower_rad: (2,).
        upper_rad: (2,).
        step_rad: largest |u| of (15).
    """

    def __init__(self, lower_rad: FloatArray, upper_rad: FloatArray, step_rad: float) -> None:
        self.lower_rad = float(lower_rad[0]), float(lower_rad[1])
        self.upper_rad = float(upper_rad[0]), float(upper_rad[1])
        self.step_rad = step_rad
        self._by_steps: dict[int, tuple[FloatArray, FloatArray, FloatArray]] = {}

    def over(self, steps: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows that turn flat angles into moves, then lower and upper of angles and moves."""
        if steps not in self._by_steps:
            rows = np.eye(2 * steps) - np.eye(2 * steps, k=-2)
            limit = np.full(2 * steps, self.step_rad)
            lower = np.concatenate([np.tile(self.lower_rad, steps), -limit])
            upper = np.concatenate([np.tile(self.upper_rad, steps), limit])
            self._by_steps[steps] = rows, lower, upper
        return self._by_steps[steps]

    def clip(self, angles: tuple[float, float]) -> tuple[float, float]:
        """The nearest pair of motor angles within their limits."""
        (lower_1, lower_2), (upper_1, upper_2) = self.lower_rad, self.upper_rad
        return min(max(angles[0], lower_1), upper_1), min(max(angles[1], lower_2), upper_2)

    def feasible(self, start_rad: tuple[float, float], angles: Angles) -> Angles:
        """The angles, each moved as little as the bounds and its predecessor ask.

        ``start_rad`` is within the limits.
        """
        inside: Angles = []
        reach = self.step_rad
        first, second = start_rad
        for angle_1, angle_2 in angles:
            near_1 = min(max(angle_1, first - reach), first + reach)
            near_2 = min(max(angle_2, second - reach), second + reach)
            first, second = self.clip((near_1, near_2))
            inside.append((first, second))
        return inside


class Solution(NamedTuple):
    """The best rollout found, and how."""

    rollout: Rollout
    iterations: int
    converged: bool


def solve(problem: Tracking, bounds: Bounds, guess: Angles) -> Solution:
    """Descend from a feasible guess to a local minimum.

    Args:
        problem: with a horizon of M steps.
        bounds: that ``guess`` satisfies.
        guess: M pairs of motor angles.

    Returns:
        A feasible solution that costs no more than the guess.

    Raises:
        SolverError: not even one step could be computed.
    """
    rollout = roll_out(problem, guess)
    if not math.isfinite(rollout.cost):
        raise SolverError("the cost is not finite")
    for iteration in range(1, MAX_ITERATIONS + 1):
        try:
            step, promised, blend = _newton_step(problem, bounds, rollout)
        except SolverError:
            if iteration == 1:
                raise
            return Solution(rollout, iteration, converged=False)
        if promised <= _ROUNDING * rollout.cost:
            return Solution(rollout, iteration, converged=True)
        candidate, share = _backtrack(problem, rollout, step, promised)
        if candidate is None:
            # The decrease drowns in rounding: as good as it gets.
            return Solution(rollout, iteration, converged=True)
        rollout = candidate
        is_newton = blend == 1.0 and share == 1.0
        if is_newton and _left_over(promised, step) <= _TOLERANCE * rollout.cost:
            return Solution(rollout, iteration, converged=True)
    return Solution(rollout, MAX_ITERATIONS, converged=False)


def _newton_step(
    problem: Tracking, bounds: Bounds, rollout: Rollout
) -> tuple[FloatArray, float, float]:
    """Step over the flat angles, the decrease its model promises, the blend used."""
    expansion = expand(problem, rollout)
    rows, lower, upper = _linearised_bounds(bounds, rollout)
    for blend in _BLENDS:
        hessian = _hessian(expansion, blend)
        try:
            step, minimum = solve_box_qp(hessian, expansion.gradient, rows, lower, upper)
        except NotConvexError:
            continue
        except QpError as error:
            raise SolverError(str(error)) from None
        return step, -minimum, blend
    raise SolverError("the Hessian is not positive definite")


def _left_over(promised: float, step: FloatArray) -> float:
    """Decrease still to be had after a full Newton step: convergence is quadratic."""
    return promised * float(step.dot(step)) * _LEFT_OVER_PER_RAD2


def _backtrack(
    problem: Tracking, rollout: Rollout, step: FloatArray, promised: float
) -> tuple[Rollout | None, float]:
    """The first of the step and its halves that lowers the cost enough, and its share."""
    moves = step.reshape(-1, 2).tolist()
    share = 1.0
    for _ in range(_MAX_HALVINGS):
        angles = [
            (angle[0] + share * move[0], angle[1] + share * move[1])
            for angle, move in zip(rollout.angles, moves, strict=True)
        ]
        candidate = roll_out(problem, angles)
        if candidate.cost <= rollout.cost - _SUFFICIENT_DECREASE * share * promised:
            return candidate, share
        share *= 0.5
    return None, 0.0


def _linearised_bounds(
    bounds: Bounds, rollout: Rollout
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bounds of the step as ``solve_box_qp`` takes them: rows, lower, upper."""
    steps = len(rollout.angles)
    rows, lower, upper = bounds.over(steps)
    now = np.array(list(chain(*rollout.angles, *rollout.moves)))
    return rows, lower - now, upper - now


def _hessian(expansion: Expansion, blend: float) -> FloatArray:
    if blend == 1.0:
        return expansion.gauss_newton + expansion.curvature
    if blend > 0.0:
        return expansion.gauss_newton + blend * expansion.curvature
    ridge = _RIDGE * float(np.trace(expansion.gauss_newton))
    return expansion.gauss_newton + ridge * np.eye(len(expansion.gradient))
