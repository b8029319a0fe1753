"""Solves the quadratic program of an iteration.

Without bounds by a Riccati recursion over the stages, whose time is linear in the horizon and cubic
in the motors. If its minimum violates a bound, by DAQP on the condensed program, whose time is
cubic in both but which is faster for few angles, as it takes few calls of NumPy. DAQP was the
fastest packaged solver on this problem and never failed.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import daqp
import numpy as np
from scipy.linalg.lapack import dposv

from ccr_host.control.mpc.problem import Expansion
from ccr_host.core.arrays import Array, IntArray
from ccr_host.robot.kinematics import products

OPTIMAL, NOT_CONVEX, FAILED, BOUND = 0, 1, 2, 3
"""BOUND, in machine code only: a bound is active, so DAQP must solve the program."""

_SHORT = 80
"""Angles up to which DAQP is faster in plain Python."""
_DAQP_OPTIMAL = 1
_DAQP_NOT_CONVEX = -5


def minimise(
    expansion: Expansion, blend: float, ridge: float, lower: Array, upper: Array
) -> tuple[int, Array, float]:
    """Minimise the sum over all stages of the residuals' squares / 2 + ``blend`` z' C z / 2.

    Args:
        expansion: in M steps of n angles.
        blend: fraction of the exact curvature.
        ridge: added to the Hessian's diagonal.
        lower: bounds of dq_j, then of dq_j - dq_(j-1), (2, M, n).
        upper: likewise.

    Returns:
        OPTIMAL, NOT_CONVEX or FAILED (infeasible, or not finite); changes of the angles, (M, n),
        within their bounds to 1e-6; the minimum.
    """
    if is_short(lower[0].size):
        return minimise_within(expansion, blend, ridge, lower, upper)
    status, changes, minimum = minimise_freely(expansion, blend, ridge)
    if status == OPTIMAL:
        moves = changes.copy()
        moves[1:] -= changes[:-1]
        beyond = (changes < lower[0]) | (changes > upper[0]) | (moves < lower[1])
        if (beyond | (moves > upper[1])).any():
            return minimise_within(expansion, blend, ridge, lower, upper)
    return status, changes, minimum


def is_short(angles: int) -> bool:
    """Whether the condensed program is faster than the recursion even without active bounds."""
    return angles <= _SHORT


def minimise_freely(expansion: Expansion, blend: float, ridge: float) -> tuple[int, Array, float]:
    """``minimise`` without bounds.

    With x' V x / 2 as the cost of all later stages for an outcome x of a stage with the Hessian H,
    the cost from that stage on is z' (T' V T + H) z / 2; eliminating dq_j leaves V for the stage
    before. The program is convex if each of these eliminations is.
    """
    constants, residuals, effects, curvature = expansion
    steps, _, n, _ = curvature.shape
    linear = np.empty((steps, 2 * n + 4, 3 + n))
    linear[:] = constants.linear
    linear[:, : 2 * n, :3], linear[:, 2 * n + 3] = effects, residuals
    transitions = np.empty((steps, n + 4, 2 * n + 4))
    transitions[:] = constants.transition
    transitions[:, n : n + 3, : 2 * n] = effects.transpose(0, 2, 1)
    hessians = products(linear, linear.transpose(0, 2, 1))
    bent = blend * curvature.reshape(steps, 2, 2, n, n).transpose(0, 1, 3, 2, 4)
    hessians[:, : 2 * n, : 2 * n] += np.ascontiguousarray(bent).reshape(steps, 2 * n, 2 * n)
    hessians[:, 2 * n + 3, 2 * n + 3] = 0.0
    for motor in range(n if ridge > 0.0 else 0):
        hessians[:, motor, motor] += ridge
    changes, gains = np.zeros((steps, n)), np.empty((steps, n, n + 4))
    value = np.zeros((n + 4, n + 4))
    for j in range(steps - 1, -1, -1):
        transition = transitions[j]
        stage = products(transition.T, products(value, transition)) + hessians[j]
        is_convex, gain = solved(stage[:n, :n], stage[:n, n:])
        if not is_convex:
            return NOT_CONVEX, changes, 0.0
        gains[j] = gain
        value = stage[n:, n:] - products(stage[n:, :n], gain)
    minimum = 0.5 * value[n + 3, n + 3]
    z = np.zeros((2 * n + 4, 1))
    z[2 * n + 3] = 1.0
    for j in range(steps):
        z[:n] = -products(gains[j], z[n:])
        changes[j] = z[:n, 0]
        z[n:] = products(transitions[j], z)
    return OPTIMAL if math.isfinite(minimum) else FAILED, changes, minimum


def solved(matrix: Array, right: Array) -> tuple[bool, Array]:
    """Divide by a symmetric matrix.

    Args:
        matrix: (n, n).
        right: (n, k).

    Returns:
        Whether the matrix is positive definite; if so, its inverse times ``right``, (n, k).
    """
    _, solution, failure = dposv(matrix, right)
    return failure == 0, solution


def solved_by_loops(matrix: Array, right: Array) -> tuple[bool, Array]:
    """``solved`` in machine code, where LAPACK takes longer for such small matrices."""
    n, columns = right.shape
    factor, solution = matrix.copy(), right.copy()
    for k in range(n):
        pivot = factor[k, k]
        if not pivot > 0.0:
            return False, solution
        scale = 1.0 / math.sqrt(pivot)
        for j in range(k, n):
            factor[k, j] *= scale
        for c in range(columns):
            solution[k, c] *= scale
        for i in range(k + 1, n):
            weight = factor[k, i]
            for j in range(i, n):
                factor[i, j] -= weight * factor[k, j]
            for c in range(columns):
                solution[i, c] -= weight * solution[k, c]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            weight = factor[i, j]
            for c in range(columns):
                solution[i, c] -= weight * solution[j, c]
        scale = 1.0 / factor[i, i]
        for c in range(columns):
            solution[i, c] *= scale
    return True, solution


def minimise_within(
    expansion: Expansion, blend: float, ridge: float, lower: Array, upper: Array
) -> tuple[int, Array, float]:
    """``minimise`` by DAQP."""
    hessian, gradient = condensed(expansion, blend, ridge)
    # eps_prox = 0: DAQP's Cholesky must reject an indefinite Hessian, not repair it.
    step, minimum, flag, _ = daqp.solve(
        hessian,
        gradient,
        _layout(*lower[0].shape).differences,
        upper.ravel(),
        lower.ravel(),
        eps_prox=0.0,
    )
    changes = step.reshape(lower[0].shape)
    if flag == _DAQP_NOT_CONVEX:
        return NOT_CONVEX, changes, 0.0
    # DAQP propagates NaN and reports it as optimal.
    if flag != _DAQP_OPTIMAL or not math.isfinite(minimum):
        return FAILED, changes, 0.0
    return OPTIMAL, changes, minimum


def condensed(expansion: Expansion, blend: float, ridge: float) -> tuple[Array, Array]:
    """Hessian and gradient by all angles, (M n, M n) and (M n,)."""
    constants, residuals, effects, curvature = expansion
    steps, _, n, _ = curvature.shape
    layout = _layout(steps, n)
    linear = layout.moves * constants.sizes[3]
    linear[layout.effects] = effects.ravel()
    rows = linear[:-1].reshape(steps, 3 + n, steps * n)
    if not constants.by_model:
        np.add.accumulate(rows[:, :3], out=rows[:, :3])
    flat = rows.reshape(-1, steps * n)
    hessian: Array = flat.T @ flat
    bent = np.bincount(layout.curvature, (blend * curvature).ravel(), hessian.size + 1)[:-1]
    hessian += bent.reshape(hessian.shape)
    if ridge > 0.0:
        hessian += ridge * np.eye(steps * n)
    return hessian, residuals.ravel() @ flat


class _Layout(NamedTuple):
    """Where the condensed program has what an expansion has, and in the end what is left out."""

    differences: Array
    """The rows that convert dq_j to dq_j - dq_(j-1), (M n, M n)."""
    moves: Array
    """Residuals u_j by the angles, of (M, 3 + n, M, n) numbers and 0."""
    effects: IntArray
    """Places in these of (M, 2n, 3)."""
    curvature: IntArray
    """Places in the Hessian, (M n)^2 numbers, of (M, 4, n, n)."""


@lru_cache(maxsize=128)
def _layout(steps: int, n: int) -> _Layout:
    differences = np.eye(steps * n) - np.eye(steps * n, k=-n)
    moves = np.zeros((steps, 3 + n, steps, n))
    moves[:, 3:] = differences.reshape(steps, n, steps, n)
    stage, which, motor, axis = np.ogrid[:steps, :2, :n, :3]
    effects = ((stage * (3 + n) + axis) * steps + stage - which) * n + motor
    effects[0, 1] = moves.size
    stage, first, second, row, column = np.ogrid[:steps, :2, :2, :n, :n]
    curvature = ((stage - first) * n + row) * steps * n + (stage - second) * n + column
    curvature[0, 1:], curvature[0, :, 1:] = differences.size, differences.size
    flat = np.append(moves, 0.0)
    return _Layout(differences, flat, effects.ravel(), curvature.ravel())
