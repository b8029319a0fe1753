"""Where the MPC's iterations begin: the plan of the step before, brought up to date."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.nlp import Angles, Tracking


def shift(plan: Angles, reachable: Angles, now: int, steps: int) -> Angles:
    """The last plan without its first step, continued as the reachable path goes on.

    ``reachable[now]`` belongs to the first of the ``steps`` to plan.
    """
    shifted = plan[1 : 1 + steps]
    last = shifted[-1] if shifted else plan[-1]
    for step in range(now + len(shifted), now + steps):
        before, after = reachable[step - 1], reachable[step]
        last = last[0] + after[0] - before[0], last[1] + after[1] - before[1]
        shifted.append(last)
    return shifted


def correct(
    plan: Angles,
    problem: Tracking,
    position_mm: NDArray[np.float64],
    expected_mm: NDArray[np.float64],
) -> Angles:
    """The plan, moved against what the measurement shows beyond the prediction; (3,) both.

    One damped least-squares step through J for the whole plan; it saves the solver about
    one iteration in three.
    """
    x, y, z = (position_mm - expected_mm).tolist()
    jet = problem.start_jet
    sagittal = complex(-y, -z)
    slope_1 = (sagittal * jet.sagittal_1).real
    slope_2 = (sagittal * jet.sagittal_2).real + x * jet.across_2
    damping = problem.weights.effort / problem.weights.position
    gram_11 = abs(jet.sagittal_1) ** 2 + damping
    gram_12 = (jet.sagittal_1 * jet.sagittal_2.conjugate()).real
    gram_22 = abs(jet.sagittal_2) ** 2 + jet.across_2**2 + damping
    determinant = gram_11 * gram_22 - gram_12 * gram_12
    if not determinant > 0.0:
        return plan
    back_1 = (gram_22 * slope_1 - gram_12 * slope_2) / determinant
    back_2 = (gram_11 * slope_2 - gram_12 * slope_1) / determinant
    return [(angle_1 - back_1, angle_2 - back_2) for angle_1, angle_2 in plan]
