"""Solves a convex quadratic program with bounds by DAQP.

DAQP was the fastest packaged solver on this problem and never failed.
"""

from __future__ import annotations

import math
from functools import lru_cache

import daqp
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

OPTIMAL, NOT_CONVEX, FAILED, BOUND = 0, 1, 2, 3
"""BOUND, in machine code only: a bound is active, so DAQP must solve the QP."""

_DAQP_OPTIMAL = 1
_DAQP_NOT_CONVEX = -5


def minimise(
    hessian: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[int, list[float], float]:
    """Minimise x' H x / 2 + g' x within bounds on the angles and on their changes.

    Args:
        hessian: (n, n), upper triangle.
        gradient: (n,).
        lower: (2n,), bounds of x first, then of x[i] - x[i-2].
        upper: (2n,), likewise.

    Returns:
        OPTIMAL, NOT_CONVEX or FAILED (infeasible, or not finite); the minimiser (n,), within its
        bounds to 1e-6; the minimum.
    """
    changes, above = _layout(len(gradient))
    # eps_prox = 0: DAQP's Cholesky must reject an indefinite Hessian, not repair it.
    step, minimum, flag, _ = daqp.solve(
        np.where(above, hessian, hessian.T), gradient, changes, upper, lower, eps_prox=0.0
    )
    if flag == _DAQP_NOT_CONVEX:
        return NOT_CONVEX, [], 0.0
    # DAQP propagates NaN and reports it as optimal.
    if flag != _DAQP_OPTIMAL or not math.isfinite(minimum):
        return FAILED, [], 0.0
    return OPTIMAL, step.tolist(), minimum


@lru_cache(maxsize=128)
def _layout(n: int) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The rows that convert angles to changes, and a mask of the upper triangle."""
    return np.eye(n) - np.eye(n, k=-2), np.triu(np.ones((n, n), np.bool_))


def minimise_without_bounds(
    hessian: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[int, FloatArray, float]:
    """``minimise`` in machine code: BOUND if the unconstrained minimum violates a bound."""
    n = len(gradient)
    factor, step = hessian.copy(), -gradient
    for k in range(n):
        pivot = factor[k, k]
        if not pivot > 0.0:
            return NOT_CONVEX, step, 0.0
        scale = 1.0 / math.sqrt(pivot)
        for j in range(k, n):
            factor[k, j] *= scale
        step[k] *= scale
        for i in range(k + 1, n):
            weight = factor[k, i]
            step[i] -= weight * step[k]
            for j in range(i, n):
                factor[i, j] -= weight * factor[k, j]
    minimum = 0.0
    for i in range(n - 1, -1, -1):
        total = step[i]
        for j in range(i + 1, n):
            total -= factor[i, j] * step[j]
        step[i] = total / factor[i, i]
        minimum += 0.5 * gradient[i] * step[i]
    for i in range(n):
        change = step[i] - step[i - 2] if i > 1 else step[i]
        if not (lower[i] <= step[i] <= upper[i] and lower[n + i] <= change <= upper[n + i]):
            return BOUND, step, minimum
    return OPTIMAL if math.isfinite(minimum) else FAILED, step, minimum
