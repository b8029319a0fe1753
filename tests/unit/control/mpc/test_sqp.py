"""The SQP against SciPy and IPOPT, from the same start, on random steps of all three paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.problem import expand, roll_out
from ccr_host.control.mpc.qp import FAILED, OPTIMAL, condensed
from ccr_host.control.mpc.sqp import Bounds, feasible, solve
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
def test_cost_is_the_minimum_that_ipopt_and_scipy_find(
    horizon, witness, random_steps, bounds, planner_within
):
    live = horizon - 1
    judge, planner = witness(live), planner_within(bounds)
    same = 0
    for step in random_steps(live, STEPS, seed=horizon):
        status, _, angles = step.planned(planner)
        assert status == sqp.CONVERGED
        here = step.moves(angles)
        ours = judge.cost(here, step)
        start = np.zeros(2 * live)
        peers = judge.minimum_by_ipopt(start, step), minimum_by_scipy(judge, step, start)
        same += all(abs(peer / ours - 1.0) <= 1e-6 for peer in peers)
        if min(peers) < ours * (1 - 1e-6):
            # Another valley: then ours is the bottom of its own.
            assert judge.minimum_by_ipopt(here, step) >= ours * (1 - 1e-6)
    assert same >= 0.9 * STEPS


@pytest.mark.long
@pytest.mark.parametrize("horizon", [4, 10])
def test_no_peer_improves_on_the_solution_when_started_there(
    horizon, witness, random_steps, bounds, planner_within
):
    live = horizon - 1
    judge, planner = witness(live), planner_within(bounds)
    for step in random_steps(live, 60, seed=100 + horizon):
        _, _, angles = step.planned(planner)
        here = step.moves(angles)
        ours = judge.cost(here, step)
        assert roll_out(step.tracking(), angles).cost == pytest.approx(ours, rel=1e-10)
        assert minimum_by_scipy(judge, step, here) >= ours * (1 - 1e-6)


@pytest.mark.parametrize("step_rad", [0.03, 0.2])
def test_bounds_hold_when_they_are_active(step_rad, random_steps, planner_within):
    lower, upper = np.array([-0.2, -0.25]), np.array([0.15, 0.3])
    tight = Bounds(lower, upper, step_rad)
    planner = planner_within(tight)
    active = 0
    for step in random_steps(3, 100, seed=5):
        moved = type(step)(step.q_rad.clip(lower, upper), step.measured_mm, step.targets_mm)
        status, _, angles = moved.planned(planner)
        assert status == sqp.CONVERGED
        moves = moved.moves(angles)
        assert np.all(angles >= lower)
        assert np.all(angles <= upper)
        assert np.abs(moves).max() <= step_rad + 1e-12
        active += np.abs(moves).max() > step_rad - 1e-5
    assert active > 10


def wild_guess(rng, step, bounds):
    return feasible(bounds, step.q_rad, rng.uniform(-1.4, 1.4, (3, 2)))


def test_solution_never_costs_more_than_the_guess(random_steps, bounds):
    rng = np.random.default_rng(6)
    for step in random_steps(3, 100, seed=6):
        guess = wild_guess(rng, step, bounds)
        before = roll_out(step.tracking(), guess).cost
        assert solve(step.tracking(), bounds, guess).rollout.cost <= before


def test_exact_hessian_is_needed_and_used(random_steps, bounds, monkeypatch):
    """Gauss-Newton alone takes far more iterations on these residuals."""
    steps = random_steps(9, 40, seed=7)

    def mean_iterations():
        return np.mean([solve(s.tracking(), bounds, s.standing_still()).iterations for s in steps])

    exact = mean_iterations()
    monkeypatch.setattr(sqp, "BLENDS", (0.0,))
    assert mean_iterations() > 2 * exact


def test_indefinite_hessian_is_blended_and_still_descends(random_steps, bounds):
    indefinite = 0
    rng = np.random.default_rng(8)
    for step in random_steps(3, 200, seed=8):
        problem = step.tracking()
        guess = wild_guess(rng, step, bounds)
        rollout = roll_out(problem, guess)
        exact, _ = condensed(expand(problem, rollout), 1.0, 0.0)
        if np.linalg.eigvalsh(exact)[0] < 0:
            indefinite += 1
            solution = solve(problem, bounds, guess)
            assert solution.status == sqp.CONVERGED
            assert solution.rollout.cost < rollout.cost
    assert indefinite > 10


def broken(*_):
    return FAILED, np.zeros((3, 2)), 0.0


def test_failing_qp_is_reported(random_steps, bounds, monkeypatch):
    monkeypatch.setattr(sqp, "minimise", broken)
    (step,) = random_steps(3, 1, seed=1)
    solution = solve(step.tracking(), bounds, step.standing_still())
    assert solution.status == sqp.QP_FAILED


def test_qp_that_fails_later_keeps_the_progress_made(random_steps, bounds, monkeypatch):
    real, solved = sqp.minimise, []

    def fails_after_one_solution(*arguments):
        if solved:
            return broken()
        answer = real(*arguments)
        if answer[0] == OPTIMAL:
            solved.append(answer)
        return answer

    monkeypatch.setattr(sqp, "minimise", fails_after_one_solution)
    (step,) = random_steps(3, 1, seed=1)
    before = roll_out(step.tracking(), step.standing_still()).cost
    solution = solve(step.tracking(), bounds, step.standing_still())
    assert solution.status == sqp.STOPPED
    assert solution.rollout.cost < before


@pytest.mark.parametrize("far_mm", [1e200, 1e308])
def test_cost_that_is_not_finite_is_reported(far_mm, random_steps, bounds, planner_within):
    (step,) = random_steps(3, 1, seed=1)
    far = type(step)(step.q_rad, np.array([far_mm, 0.0, 0.0]), step.targets_mm)
    status, _, _ = far.planned(planner_within(bounds))
    assert status == sqp.COST_NOT_FINITE
