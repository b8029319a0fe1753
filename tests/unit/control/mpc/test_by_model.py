"""The problem with errors by the model itself, as the offset-free MPC has it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ccr_host.control.mpc.problem import Constants, Tracking, Weights, expand, roll_out
from ccr_host.control.mpc.qp import condensed
from ccr_host.control.mpc.sqp import Bounds, feasible, solve
from tests.unit.control.baselines.plant import BELIEVED, DESCRIPTION, LIMITS, reference_of

STEP_BOUND_RAD = 0.15
BOUNDS = Bounds.of(LIMITS, STEP_BOUND_RAD)
CONSTANTS = Constants.of(DESCRIPTION.robot, Weights(1.0, 0.5), by_model=True)
PATHS = [reference_of(name, 1.0) for name in ("ellipse", "8shape", "star")]


def _problem(path, first, disturbance_mm):
    reference = PATHS[path]
    wanted_mm = reference.target_mm[first : first + 3] - disturbance_mm
    start_rad, free_rad = reference.q_rad[first - 1], np.zeros((3, 2))
    return Tracking(CONSTANTS, start_rad, -wanted_mm, free_rad, free_rad[0]), wanted_mm


problems = st.builds(
    _problem,
    st.integers(0, 2),
    st.integers(1, 76),
    st.tuples(*[st.floats(-8.0, 8.0)] * 3).map(np.array),
)


def cost(problem, angles):
    return roll_out(problem, np.reshape(angles, (-1, 2))).cost


def expansion(problem, angles):
    rollout = roll_out(problem, np.reshape(angles, (-1, 2)))
    return condensed(expand(problem, rollout), 1.0, 0.0)


@given(problems, st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_the_cost_is_that_of_the_models_errors_and_the_expansion_that_of_the_cost(drawn, seed):
    problem, wanted_mm = drawn
    rng = np.random.default_rng(seed)
    angles = LIMITS.clip(problem.start_rad + rng.normal(scale=0.2, size=(3, 2)))
    moves = np.diff(angles, axis=0, prepend=problem.start_rad[None])
    expected = np.sum((BELIEVED.tip_mm(angles) - wanted_mm) ** 2) + 0.5 * np.sum(moves**2)
    assert cost(problem, angles) == pytest.approx(expected, rel=1e-9)

    exact, gradient = expansion(problem, angles)
    direction, small = rng.normal(size=(3, 2)), 1e-4
    ahead = cost(problem, angles + small * direction)
    behind = cost(problem, angles - small * direction)
    flat = direction.ravel()
    scale = np.linalg.norm(exact) * (flat @ flat)
    slope, bend = gradient @ flat, flat @ exact @ flat
    assert (ahead - behind) / (2 * small) == pytest.approx(slope, abs=1e-4 * scale)
    second = (ahead - 2 * cost(problem, angles) + behind) / small**2
    assert second == pytest.approx(bend, abs=1e-3 * scale)


@given(problems)
@settings(max_examples=25, deadline=None)
def test_the_solution_is_feasible_and_no_worse_than_scipys(drawn):
    problem, _ = drawn
    guess = np.tile(problem.start_rad, (3, 1))
    angles = solve(problem, BOUNDS, guess).rollout.angles
    found = feasible(BOUNDS, problem.start_rad, angles)
    assert found == pytest.approx(angles, abs=2e-6)
    steps = np.eye(6) - np.eye(6, k=-2)
    start = np.concatenate([problem.start_rad, np.zeros(4)])
    witness = minimize(
        lambda flat: cost(problem, flat),
        found.ravel(),
        jac=lambda flat: expansion(problem, flat)[1],
        method="SLSQP",
        bounds=list(zip(np.tile(LIMITS.lower_rad, 3), np.tile(LIMITS.upper_rad, 3), strict=True)),
        constraints=[
            {"type": "ineq", "fun": lambda flat: STEP_BOUND_RAD - (steps @ flat - start)},
            {"type": "ineq", "fun": lambda flat: STEP_BOUND_RAD + (steps @ flat - start)},
        ],
    )
    assert cost(problem, found) <= witness.fun + 1e-4 * max(1.0, witness.fun)
    assert cost(problem, found) <= cost(problem, guess)
