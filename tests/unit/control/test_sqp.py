"""The SQP against SciPy and IPOPT, from the same start, on random steps of all three paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from ccr_host.control import sqp
from ccr_host.control.box_qp import QpError
from ccr_host.control.nlp import expand, roll_out
from ccr_host.control.sqp import Bounds, SolverError, solve
from ccr_host.description.schema import Description
from ccr_host.robot.workspace import MotorLimits

LIMITS = MotorLimits.of(Description().servo)
LOWER, UPPER = LIMITS.lower_rad, LIMITS.upper_rad
STEP_RAD = Description().control.step_bound_rad
STEPS = 50


def minimum_by_scipy(witness, step, start):
    """L-BFGS-B over the angles, so that the motor limits are a box; the step bound stays idle."""
    live = len(step.targets_mm)
    to_angles = np.kron(np.tril(np.ones((live, live))), np.eye(2))
    to_moves = np.linalg.inv(to_angles)
    origin = np.tile(step.q_rad, live)
    scale = witness.cost(start, step)
    result = minimize(
        lambda q: witness.cost(to_moves @ (q - origin), step) / scale,
        origin + to_angles @ start,
        jac=lambda q: to_moves.T @ witness.gradient(to_moves @ (q - origin), step) / scale,
        method="L-BFGS-B",
        bounds=list(zip(np.tile(LOWER, live), np.tile(UPPER, live), strict=True)),
        options={"ftol": 1e-16, "gtol": 1e-12, "maxiter": 5000, "maxfun": 20000, "maxcor": 30},
    )
    assert np.abs(to_moves @ (result.x - origin)).max() < STEP_RAD
    return result.fun * scale


@pytest.mark.long
@pytest.mark.parametrize("horizon", [4, pytest.param(10, marks=pytest.mark.slow)])
def test_cost_is_the_minimum_that_ipopt_and_scipy_find(horizon, witness, random_steps, bounds):
    live = horizon - 1
    judge = witness(live)
    same = 0
    for step in random_steps(live, STEPS, seed=horizon):
        solution = solve(step.tracking(), bounds, step.standing_still())
        assert solution.converged
        ours = solution.rollout.cost
        start = np.zeros(2 * live)
        peers = judge.minimum_by_ipopt(start, step), minimum_by_scipy(judge, step, start)
        same += all(abs(peer / ours - 1.0) <= 1e-6 for peer in peers)
        if min(peers) < ours * (1 - 1e-6):
            # Another valley: then ours is the bottom of its own.
            here = step.moves(solution.rollout.angles)
            assert judge.minimum_by_ipopt(here, step) >= ours * (1 - 1e-6)
    assert same >= 0.9 * STEPS


@pytest.mark.long
@pytest.mark.parametrize("horizon", [4, 10])
def test_no_peer_improves_on_the_solution_when_started_there(
    horizon, witness, random_steps, bounds
):
    live = horizon - 1
    judge = witness(live)
    for step in random_steps(live, 60, seed=100 + horizon):
        solution = solve(step.tracking(), bounds, step.standing_still())
        here = step.moves(solution.rollout.angles)
        assert judge.cost(here, step) == pytest.approx(solution.rollout.cost, rel=1e-10)
        assert minimum_by_scipy(judge, step, here) >= solution.rollout.cost * (1 - 1e-6)


@pytest.mark.parametrize("step_rad", [0.03, 0.2])
def test_bounds_hold_when_they_are_active(step_rad, random_steps):
    tight = Bounds(np.array([-0.2, -0.25]), np.array([0.15, 0.3]), step_rad)
    active = 0
    for step in random_steps(3, 100, seed=5):
        start = tight.clip(tuple(step.q_rad))
        moved = type(step)(np.array(start), step.measured_mm, step.targets_mm)
        solution = solve(moved.tracking(), tight, moved.standing_still())
        angles = np.array(solution.rollout.angles)
        moves = moved.moves(angles)
        assert np.all(angles >= np.array([-0.2, -0.25]) - 1e-5)
        assert np.all(angles <= np.array([0.15, 0.3]) + 1e-5)
        assert np.abs(moves).max() <= step_rad + 1e-5
        active += np.abs(moves).max() > step_rad - 1e-5
    assert active > 10


def test_solution_never_costs_more_than_the_guess(random_steps, bounds):
    rng = np.random.default_rng(6)
    for step in random_steps(3, 100, seed=6):
        wild = rng.uniform(-1.4, 1.4, (3, 2))
        guess = bounds.feasible(tuple(step.q_rad), [tuple(q) for q in wild])
        before = roll_out(step.tracking(), guess).cost
        assert solve(step.tracking(), bounds, guess).rollout.cost <= before


def test_exact_hessian_is_needed_and_used(random_steps, bounds, monkeypatch):
    """Gauss-Newton alone takes far more iterations on these residuals."""
    steps = random_steps(9, 40, seed=7)

    def mean_iterations():
        return np.mean([solve(s.tracking(), bounds, s.standing_still()).iterations for s in steps])

    exact = mean_iterations()
    monkeypatch.setattr(sqp, "_BLENDS", (0.0,))
    assert mean_iterations() > 2 * exact


def test_indefinite_hessian_is_blended_and_still_descends(random_steps, bounds):
    indefinite = 0
    rng = np.random.default_rng(8)
    for step in random_steps(3, 200, seed=8):
        problem = step.tracking()
        guess = bounds.feasible(
            tuple(step.q_rad), [tuple(q) for q in rng.uniform(-1.4, 1.4, (3, 2))]
        )
        rollout = roll_out(problem, guess)
        expansion = expand(problem, rollout)
        if np.linalg.eigvalsh(expansion.gauss_newton + expansion.curvature)[0] < 0:
            indefinite += 1
            solution = solve(problem, bounds, guess)
            assert solution.converged
            assert solution.rollout.cost < rollout.cost
    assert indefinite > 10


def test_failing_qp_is_reported_as_solver_error(random_steps, bounds, monkeypatch):
    def broken(*_):
        raise QpError("out of luck")

    monkeypatch.setattr(sqp, "solve_box_qp", broken)
    (step,) = random_steps(3, 1, seed=1)
    with pytest.raises(SolverError, match="out of luck"):
        solve(step.tracking(), bounds, step.standing_still())


def test_qp_that_fails_later_keeps_the_progress_made(random_steps, bounds, monkeypatch):
    real, solved = sqp.solve_box_qp, []

    def fails_after_one_solution(*arguments):
        if solved:
            raise QpError("out of luck")
        solved.append(real(*arguments))
        return solved[0]

    monkeypatch.setattr(sqp, "solve_box_qp", fails_after_one_solution)
    (step,) = random_steps(3, 1, seed=1)
    before = roll_out(step.tracking(), step.standing_still()).cost
    solution = solve(step.tracking(), bounds, step.standing_still())
    assert not solution.converged
    assert solution.rollout.cost < before


def test_cost_that_is_not_finite_is_a_solver_error(random_steps, bounds):
    (step,) = random_steps(3, 1, seed=1)
    far = type(step)(step.q_rad, np.array([1e200, 0.0, 0.0]), step.targets_mm)
    with pytest.raises(SolverError, match="finite"):
        solve(far.tracking(), bounds, far.standing_still())
