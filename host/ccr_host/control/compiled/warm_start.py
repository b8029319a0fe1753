"""Where the iterations begin: ``control.warm_start`` compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.compiled.jit import compiled
from ccr_host.control.compiled.nlp import Tracking
from ccr_host.control.compiled.sqp import Bounds

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]


@compiled
def shift(plan: FloatArray, reachable: FloatArray, now: int, steps: int) -> FloatArray:
    """The last plan (k, 2) without its first step, continued as the reachable path goes on."""
    guess = np.empty((steps, 2))
    kept = len(plan) - 1
    for motor in range(2):
        last = plan[-1, motor]
        for j in range(steps):
            if j < kept:
                guess[j, motor] = plan[1 + j, motor]
            else:
                last += reachable[now + j, motor] - reachable[now + j - 1, motor]
                guess[j, motor] = last
    return guess


@compiled
def correct(
    guess: FloatArray, problem: Tracking, position_mm: Triple, expected_mm: FloatArray
) -> None:
    """Move a plan against what the measurement shows beyond the prediction, in place."""
    jet = problem.start_jet
    x = position_mm[0] - expected_mm[0]
    sagittal = complex(expected_mm[1] - position_mm[1], expected_mm[2] - position_mm[2])
    slope_1 = (sagittal * jet.sagittal_1).real
    slope_2 = (sagittal * jet.sagittal_2).real + x * jet.across_2
    damping = problem.effort_weight / problem.position_weight
    gram_11 = abs(jet.sagittal_1) ** 2 + damping
    gram_12 = (jet.sagittal_1 * jet.sagittal_2.conjugate()).real
    gram_22 = abs(jet.sagittal_2) ** 2 + jet.across_2**2 + damping
    determinant = gram_11 * gram_22 - gram_12 * gram_12
    if determinant > 0.0:
        back_1 = (gram_22 * slope_1 - gram_12 * slope_2) / determinant
        back_2 = (gram_11 * slope_2 - gram_12 * slope_1) / determinant
        for j in range(len(guess)):
            guess[j, 0] -= back_1
            guess[j, 1] -= back_2


@compiled
def clip(bounds: Bounds, angle_1: float, angle_2: float) -> tuple[float, float]:
    """The nearest pair of motor angles within their limits."""
    return (
        min(max(angle_1, bounds.lower_1_rad), bounds.upper_1_rad),
        min(max(angle_2, bounds.lower_2_rad), bounds.upper_2_rad),
    )


@compiled
def make_feasible(guess: FloatArray, start_rad: tuple[float, float], bounds: Bounds) -> None:
    """Move each pair as little as the bounds and its predecessor ask, in place."""
    first, second = start_rad
    reach = bounds.step_rad
    for j in range(len(guess)):
        near_1 = min(max(guess[j, 0], first - reach), first + reach)
        near_2 = min(max(guess[j, 1], second - reach), second + reach)
        first, second = clip(bounds, near_1, near_2)
        guess[j, 0], guess[j, 1] = first, second
