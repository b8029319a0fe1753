import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ccr_host.control.baselines.offset_nlp import OffsetTracking, solve
from ccr_host.control.nlp import Weights
from tests.unit.control.baselines.plant import BELIEVED, LIMITS, reference_of

STEP_BOUND_RAD = 0.15
WEIGHTS = Weights(1.0, 0.5)
PATHS = [reference_of(name, 1.0) for name in ("ellipse", "8shape", "star")]


def _problem(path, first, disturbance_mm):
    reference = PATHS[path]
    wanted_mm = reference.target_mm[first : first + 3] - disturbance_mm
    return OffsetTracking(BELIEVED, WEIGHTS, reference.q_rad[first - 1], wanted_mm)


problems = st.builds(
    _problem,
    st.integers(0, 2),
    st.integers(1, 76),
    st.tuples(*[st.floats(-8.0, 8.0)] * 3).map(np.array),
)


@given(problems, st.integers(0, 2**31))
@settings(max_examples=25, deadline=None)
def test_the_expansion_is_that_of_the_cost(problem, seed):
    rng = np.random.default_rng(seed)
    angles = LIMITS.clip(problem.start_rad + rng.normal(scale=0.2, size=(3, 2)))
    direction = rng.normal(size=(3, 2))
    gradient, gauss_newton, curvature = problem.expand(angles)
    small = 1e-4
    ahead, behind = (
        problem.cost(angles + small * direction),
        problem.cost(angles - small * direction),
    )
    flat = direction.ravel()
    slope, bend = gradient @ flat, flat @ (gauss_newton + curvature) @ flat
    scale = np.linalg.norm(gauss_newton) * (flat @ flat)
    assert (ahead - behind) / (2 * small) == pytest.approx(slope, abs=1e-4 * scale)
    second = (ahead - 2 * problem.cost(angles) + behind) / small**2
    assert second == pytest.approx(bend, abs=1e-3 * scale)


@given(problems)
@settings(max_examples=25, deadline=None)
def test_the_solution_is_feasible_and_no_worse_than_scipys(problem):
    guess = np.tile(problem.start_rad, (3, 1))
    found = solve(problem, LIMITS, STEP_BOUND_RAD, guess)
    assert (LIMITS.clip(found) == found).all()
    moves = np.diff(found, axis=0, prepend=problem.start_rad[None])
    assert np.abs(moves).max() <= STEP_BOUND_RAD + 1e-9
    steps = np.eye(6) - np.eye(6, k=-2)
    start = np.concatenate([problem.start_rad, np.zeros(4)])
    witness = minimize(
        lambda flat: problem.cost(flat.reshape(3, 2)),
        found.ravel(),
        jac=lambda flat: problem.expand(flat.reshape(3, 2)).gradient,
        method="SLSQP",
        bounds=list(zip(np.tile(LIMITS.lower_rad, 3), np.tile(LIMITS.upper_rad, 3), strict=True)),
        constraints=[
            {"type": "ineq", "fun": lambda flat: STEP_BOUND_RAD - (steps @ flat - start)},
            {"type": "ineq", "fun": lambda flat: STEP_BOUND_RAD + (steps @ flat - start)},
        ],
    )
    assert problem.cost(found) <= witness.fun + 0.02 * max(1.0, witness.fun)
    assert problem.cost(found) <= problem.cost(guess)
