"""The iteration of ``control.sqp``, with its constants."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control import sqp
from ccr_host.control.compiled import box_qp
from ccr_host.control.compiled.box_qp import solve_box_qp
from ccr_host.control.compiled.jit import compiled
from ccr_host.control.compiled.nlp import (
    Expansion,
    Rollout,
    Tracking,
    expand,
    new_expansion,
    new_rollout,
    roll_out,
    write_hessian,
)

FloatArray = NDArray[np.float64]

CONVERGED, STOPPED, COST_NOT_FINITE, NOT_CONVEX, QP_FAILED = 0, 1, 2, 3, 4


class Bounds(NamedTuple):
    """On both motor angles and on their changes."""

    lower_1_rad: float
    lower_2_rad: float
    upper_1_rad: float
    upper_2_rad: float
    step_rad: float


@compiled
def solve(problem: Tracking, bounds: Bounds, guess: FloatArray) -> tuple[int, int, Rollout]:
    """Descend from a feasible guess (M, 2); see ``control.sqp.solve``.

    Returns:
        CONVERGED or STOPPED, or why there is no solution; the iterations; the best rollout.
    """
    steps = len(guess)
    rollout, candidate = new_rollout(problem), new_rollout(problem)
    for j in range(steps):
        rollout.angles[j, 0], rollout.angles[j, 1] = guess[j, 0], guess[j, 1]
    cost = roll_out(problem, rollout)
    if not math.isfinite(cost):
        return COST_NOT_FINITE, 0, rollout
    expansion = new_expansion(steps)
    hessian = np.empty((2 * steps, 2 * steps))
    for iteration in range(1, sqp.MAX_ITERATIONS + 1):
        expand(problem, rollout, expansion)
        lower, upper = _room(bounds, rollout)
        status, step, promised, blend = _newton_step(
            expansion, problem.effort_weight, lower, upper, hessian
        )
        if status != CONVERGED:
            return (status if iteration == 1 else STOPPED), iteration, rollout
        if promised <= sqp._ROUNDING * cost:
            return CONVERGED, iteration, rollout
        share, cost = _backtrack(problem, rollout, cost, step, promised, candidate)
        if share == 0.0:
            return CONVERGED, iteration, rollout
        rollout, candidate = candidate, rollout
        squared_step = 0.0
        for angle in step:
            squared_step += angle * angle
        left_over = promised * squared_step * sqp._LEFT_OVER_PER_RAD2
        if blend == 1.0 and share == 1.0 and left_over <= sqp._TOLERANCE * cost:
            return CONVERGED, iteration, rollout
    return STOPPED, sqp.MAX_ITERATIONS, rollout


@compiled
def _newton_step(
    expansion: Expansion,
    effort_weight: float,
    lower: FloatArray,
    upper: FloatArray,
    hessian: FloatArray,
) -> tuple[int, FloatArray, float, float]:
    """CONVERGED or a failure; the step, the decrease its model promises, the blend used."""
    step = expansion.gradient
    for blend in sqp._BLENDS:
        ridge = sqp._RIDGE if blend == 0.0 else 0.0
        write_hessian(hessian, expansion, effort_weight, blend, ridge)
        status, step, minimum = solve_box_qp(hessian, expansion.gradient, lower, upper)
        if status == box_qp.OPTIMAL:
            return CONVERGED, step, -minimum, blend
        if status == box_qp.FAILED:
            return QP_FAILED, step, 0.0, blend
    return NOT_CONVEX, step, 0.0, 0.0


@compiled
def _backtrack(
    problem: Tracking,
    rollout: Rollout,
    cost: float,
    step: FloatArray,
    promised: float,
    candidate: Rollout,
) -> tuple[float, float]:
    """Share of the step that lowers the cost enough, 0 for none, and the cost then."""
    share = 1.0
    for _ in range(sqp._MAX_HALVINGS):
        for j in range(len(rollout.angles)):
            candidate.angles[j, 0] = rollout.angles[j, 0] + share * step[2 * j]
            candidate.angles[j, 1] = rollout.angles[j, 1] + share * step[2 * j + 1]
        lowered = roll_out(problem, candidate)
        if lowered <= cost - sqp._SUFFICIENT_DECREASE * share * promised:
            return share, lowered
        share *= 0.5
    return 0.0, cost


@compiled
def _room(bounds: Bounds, rollout: Rollout) -> tuple[FloatArray, FloatArray]:
    """Bounds of the step, as ``solve_box_qp`` takes them."""
    n = rollout.angles.size
    lower, upper = np.empty(2 * n), np.empty(2 * n)
    for j in range(len(rollout.angles)):
        angle_1, angle_2 = rollout.angles[j, 0], rollout.angles[j, 1]
        lower[2 * j], upper[2 * j] = bounds.lower_1_rad - angle_1, bounds.upper_1_rad - angle_1
        lower[2 * j + 1] = bounds.lower_2_rad - angle_2
        upper[2 * j + 1] = bounds.upper_2_rad - angle_2
        for motor in range(2):
            lower[n + 2 * j + motor] = -bounds.step_rad - rollout.moves[j, motor]
            upper[n + 2 * j + motor] = bounds.step_rad - rollout.moves[j, motor]
    return lower, upper
