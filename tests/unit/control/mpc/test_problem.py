"""Cost, gradient and Hessian against automatic differentiation of the printed equations."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.mpc.problem import expand, roll_out
from ccr_host.control.mpc.qp import condensed
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature

MODEL = ConstantCurvature(Description().robot)


def somewhere(step, rng):
    return step.q_rad + rng.normal(scale=0.4, size=(len(step.targets_mm), 2))


@pytest.mark.parametrize("live", [1, 2, 3, 9])
def test_cost_and_derivatives_match_automatic_differentiation(live, witness, random_steps):
    rng = np.random.default_rng(live)
    # q = q_0 + cumulative sum of u: derivatives in u follow from those in q.
    to_angles = np.kron(np.tril(np.ones((live, live))), np.eye(2))
    for step in random_steps(live, 30, seed=live):
        angles = somewhere(step, rng)
        moves = step.moves(angles)
        rollout = roll_out(step.tracking(), angles)
        exact, slope = condensed(expand(step.tracking(), rollout), 1.0, 0.0)
        assert rollout.cost == pytest.approx(witness(live).cost(moves, step), rel=1e-12)
        gradient = to_angles.T @ slope
        expected = witness(live).gradient(moves, step)
        assert gradient == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
        exact = to_angles.T @ exact @ to_angles
        expected = witness(live).hessian(moves, step)
        assert exact == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())


def test_gauss_newton_part_is_positive_semidefinite(random_steps):
    rng = np.random.default_rng(0)
    for step in random_steps(3, 50, seed=9):
        problem = step.tracking(effort_weight=0.0)
        expansion = expand(problem, roll_out(problem, somewhere(step, rng)))
        values = np.linalg.eigvalsh(condensed(expansion, 0.0, 0.0)[0])
        assert values[0] >= -1e-9 * values[-1]


def test_errors_are_prediction_minus_target(random_steps):
    """(14) with J where each increment sets out, first increment from the measured pose."""
    (step,) = random_steps(2, 1, seed=1)
    rollout = roll_out(step.tracking(), np.array([[0.3, -0.2], [0.1, 0.4]]))
    predicted = step.measured_mm + MODEL.jacobian_mm_rad(step.q_rad) @ (
        np.array([0.3, -0.2]) - step.q_rad
    )
    assert rollout.errors_mm[0] == pytest.approx(predicted - step.targets_mm[0])
    predicted = predicted + MODEL.jacobian_mm_rad([0.3, -0.2]) @ np.array([-0.2, 0.6])
    assert rollout.errors_mm[1] == pytest.approx(predicted - step.targets_mm[1])
