"""A primal active-set method for the QP of one SQP iteration.

Bounds lie on the angles and on their changes from step to step. Of each motor's chain of angles
the active bounds on changes tie neighbours together and the active bounds on angles hold one in
place. So the free directions are groups of tied angles that nothing holds, which move as one, and
the reduced Hessian is a sum over rows and columns: no factorisation of constraints. Where the
unconstrained minimum fits the bounds, as it nearly always does along the paper's paths, it is the
solution, at the price of one Cholesky factorisation.

The start, x = 0, is feasible, and so is every point on the way.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.compiled.jit import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OPTIMAL, NOT_CONVEX, FAILED = 0, 1, 2

_MOTORS = 2
_HELD = -1
# A bound nearer than this to the start (rad) is taken for active from the outset.
_ACTIVE_RAD = 1e-9
# Of the largest slope: what a multiplier of the wrong sign may be by rounding.
_ROUNDING = 1e-12
# Each change of the active set lowers the objective, so each set comes once; this is far above
# what any problem took, and bounds the time.
_CHANGES_PER_BOUND = 10


@compiled
def solve_box_qp(
    hessian: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[int, FloatArray, float]:
    """Minimise x' H x / 2 + g' x between bounds on the angles and on their changes.

    Args:
        hessian: (n, n), upper triangle.
        gradient: (n,).
        lower: (2n,), of x first, then of x[i] - x[i-2]; none above 0.
        upper: (2n,), none below 0.

    Returns:
        OPTIMAL, NOT_CONVEX or FAILED; the minimiser (n,); the minimum.
    """
    n = len(gradient)
    step = np.empty(n)
    factor = np.empty((n, n))
    if not _factorise(hessian, n, factor):
        return NOT_CONVEX, step, 0.0
    for i in range(n):
        step[i] = -gradient[i]
    _back_substitute(factor, n, step)
    if not _fits(step, lower, upper):
        return _walk_along_bounds(hessian, gradient, lower, upper, step)
    minimum = 0.0
    for i in range(n):
        minimum += 0.5 * gradient[i] * step[i]
    return (OPTIMAL if math.isfinite(minimum) else FAILED), step, minimum


@compiled
def _fits(step: FloatArray, lower: FloatArray, upper: FloatArray) -> bool:
    n = len(step)
    for i in range(n):
        change = step[i] - step[i - 2] if i >= _MOTORS else step[i]
        if not (lower[i] <= step[i] <= upper[i] and lower[n + i] <= change <= upper[n + i]):
            return False
    return True


@compiled
def _walk_along_bounds(
    hessian: FloatArray,
    gradient: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    step: FloatArray,
) -> tuple[int, FloatArray, float]:
    """From bound to bound until no multiplier of an active one has the wrong sign."""
    n = len(gradient)
    active = _initially_active(lower, upper)
    slope, direction = np.empty(n), np.empty(n)
    steepest = 0.0
    for i in range(n):
        step[i], slope[i] = 0.0, gradient[i]
        steepest = max(steepest, abs(gradient[i]))
    for _ in range(_CHANGES_PER_BOUND * 2 * n):
        groups, count = _free_groups(active)
        _descend_in_groups(hessian, slope, groups, count, direction)
        share, blocking, side = _longest_share(step, direction, active, lower, upper)
        for i in range(n):
            step[i] += share * direction[i]
        _write_slope(hessian, gradient, step, slope)
        if blocking >= 0:
            active[blocking] = side
            continue
        wrong = _most_wrong_bound(slope, active, _ROUNDING * steepest)
        if wrong >= 0:
            active[wrong] = 0
            continue
        minimum = 0.0
        for i in range(n):
            minimum += 0.5 * step[i] * (slope[i] + gradient[i])
        return (OPTIMAL if math.isfinite(minimum) else FAILED), step, minimum
    return FAILED, step, 0.0


@compiled
def _factorise(matrix: FloatArray, n: int, factor: FloatArray) -> bool:
    """Upper Cholesky factor; false if the matrix is not positive definite."""
    for i in range(n):
        for j in range(i, n):
            factor[i, j] = matrix[i, j]
    for k in range(n):
        pivot = factor[k, k]
        if not pivot > 0.0:
            return False
        scale = 1.0 / math.sqrt(pivot)
        for j in range(k, n):
            factor[k, j] *= scale
        for i in range(k + 1, n):
            weight = factor[k, i]
            for j in range(i, n):
                factor[i, j] -= weight * factor[k, j]
    return True


@compiled
def _back_substitute(factor: FloatArray, n: int, vector: FloatArray) -> None:
    """Solve with R' R, in place."""
    for i in range(n):
        vector[i] /= factor[i, i]
        for j in range(i + 1, n):
            vector[j] -= factor[i, j] * vector[i]
    for i in range(n - 1, -1, -1):
        total = vector[i]
        for j in range(i + 1, n):
            total -= factor[i, j] * vector[j]
        vector[i] = total / factor[i, i]


@compiled
def _initially_active(lower: FloatArray, upper: FloatArray) -> IntArray:
    """Independent ones among the bounds that the start rests on: -1 lower, 1 upper, 0 none."""
    n = len(lower) // 2
    active = np.zeros(2 * n, np.int64)
    for motor in range(2):
        held = True
        for i in range(motor, n, 2):
            active[n + i] = _touched(lower[n + i], upper[n + i])
            if active[n + i] == 0:
                held = False
            if not held:
                active[i] = _touched(lower[i], upper[i])
                held = active[i] != 0
    return active


@compiled
def _touched(lower: float, upper: float) -> int:
    if upper < _ACTIVE_RAD:
        return 1
    return -1 if lower > -_ACTIVE_RAD else 0


@compiled
def _free_groups(active: IntArray) -> tuple[IntArray, int]:
    """The group of each angle, or _HELD, and how many groups there are."""
    n = len(active) // 2
    groups = np.empty(n, np.int64)
    count = 0
    for motor in range(2):
        first = motor
        while first < n:
            held = first < _MOTORS and active[n + first] != 0
            end = first
            while True:
                held |= active[end] != 0
                end += 2
                if end >= n or active[n + end] == 0:
                    break
            for i in range(first, end, 2):
                groups[i] = _HELD if held else count
            count += 0 if held else 1
            first = end
    return groups, count


@compiled
def _descend_in_groups(
    hessian: FloatArray, slope: FloatArray, groups: IntArray, count: int, direction: FloatArray
) -> None:
    """Step to the minimum over the groups' common movements."""
    n = len(groups)
    reduced = np.zeros((count, count))
    downhill = np.zeros(count)
    for i in range(n):
        a = groups[i]
        if a == _HELD:
            continue
        downhill[a] -= slope[i]
        reduced[a, a] += hessian[i, i]
        for j in range(i + 1, n):
            b = groups[j]
            if b == _HELD:
                continue
            reduced[min(a, b), max(a, b)] += hessian[i, j] * (2.0 if a == b else 1.0)
    factor = np.empty((count, count))
    _factorise(reduced, count, factor)
    _back_substitute(factor, count, downhill)
    for i in range(n):
        direction[i] = 0.0 if groups[i] == _HELD else downhill[groups[i]]


@compiled
def _longest_share(
    step: FloatArray,
    direction: FloatArray,
    active: IntArray,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[float, int, int]:
    """How much of the direction fits, which bound stops it (-1: none), on which side."""
    n = len(step)
    share, blocking, side = 1.0, -1, 0
    for i in range(2 * n):
        if active[i] != 0:
            continue
        at, speed = (step[i], direction[i]) if i < n else _change(step, direction, i - n)
        if speed > 0.0:
            room = max(upper[i] - at, 0.0)
        elif speed < 0.0:
            room = min(lower[i] - at, 0.0)
        else:
            continue
        if share * abs(speed) > abs(room):
            share, blocking, side = room / speed, i, (1 if speed > 0.0 else -1)
    return share, blocking, side


@compiled
def _change(step: FloatArray, direction: FloatArray, i: int) -> tuple[float, float]:
    if i < _MOTORS:
        return step[i], direction[i]
    return step[i] - step[i - 2], direction[i] - direction[i - 2]


@compiled
def _write_slope(
    hessian: FloatArray, gradient: FloatArray, step: FloatArray, slope: FloatArray
) -> None:
    n = len(step)
    for i in range(n):
        slope[i] = gradient[i]
    for i in range(n):
        total = hessian[i, i] * step[i]
        for j in range(i + 1, n):
            total += hessian[i, j] * step[j]
            slope[j] += hessian[i, j] * step[i]
        slope[i] += total


@compiled
def _most_wrong_bound(slope: FloatArray, active: IntArray, tolerance: float) -> int:
    """The active bound whose multiplier has the wrong sign and is largest; -1 if none.

    Along a chain slope[i] + at[i] + tie[i] - tie[i+2] = 0, with at the multiplier of the bound on
    the angle, tie that of the bound on its change.
    """
    n = len(slope)
    worst, wrong = tolerance, -1
    for motor in range(2):
        tie = 0.0
        for i in range(motor + 2 * ((n - 1 - motor) // 2), -1, -2):
            # The one bound on an angle in a group takes up what the group's slopes leave: those
            # after it (in tie) and those before it.
            at = 0.0
            if active[i] != 0:
                at = tie - slope[i]
                before = i
                while active[n + before] != 0 and before >= _MOTORS:
                    before -= 2
                    at -= slope[before]
            for bound, multiplier in ((i, at), (n + i, tie - slope[i] - at)):
                if active[bound] != 0 and -multiplier * active[bound] > worst:
                    worst, wrong = -multiplier * active[bound], bound
            tie = tie - slope[i] - at if active[n + i] != 0 else 0.0
    return wrong
