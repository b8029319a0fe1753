"""The QP of an iteration: the recursion over the stages and DAQP on the condensed program."""

from __future__ import annotations

import numpy as np
import pytest

from bench.any_robot import random_robot
from ccr_host.control.mpc import qp
from ccr_host.control.mpc.problem import Constants, Expansion, Tracking, Weights, expand, roll_out
from ccr_host.control.mpc.qp import (
    FAILED,
    NOT_CONVEX,
    OPTIMAL,
    condensed,
    minimise,
    minimise_freely,
    minimise_within,
    solved,
    solved_by_loops,
)

WIDE = 1e3


def program(rng, steps, by_model=False, effort_weight=20.0) -> Expansion:
    """The expansion of a random robot's problem anywhere."""
    robot = random_robot(rng, int(rng.integers(1, 4)))
    weights = Weights(1.0, effort_weight)
    constants = Constants.of(robot, weights, by_model=by_model)
    n = len(constants.chain.bending)
    free_rad = 0.1 * rng.normal(size=(steps, n))
    offsets_mm = 5.0 * rng.normal(size=(steps, 3))
    start_rad, extra_rad = 0.1 * rng.normal(size=(2, n))
    problem = Tracking(constants, start_rad, offsets_mm, free_rad, extra_rad)
    angles = problem.start_rad + 0.1 * rng.normal(size=(steps, n))
    return expand(problem, roll_out(problem, angles))


def room(expansion, size):
    steps, _, n, _ = expansion.curvature.shape
    return np.full((2, steps, n), -size), np.full((2, steps, n), size)


@pytest.mark.parametrize("by_model", [False, True])
@pytest.mark.parametrize("steps", [1, 2, 3, 9, 19])
def test_the_recursion_solves_the_condensed_program(steps, by_model):
    rng = np.random.default_rng(steps)
    convex = 0
    for _ in range(20):
        expansion = program(rng, steps, by_model)
        blend, ridge = rng.choice([1.0, 0.5, 0.0]), rng.choice([0.0, 0.1])
        hessian, gradient = condensed(expansion, blend, ridge)
        assert hessian == pytest.approx(hessian.T, abs=1e-9 * np.abs(hessian).max())
        status, changes, minimum = minimise_freely(expansion, blend, ridge)
        values = np.linalg.eigvalsh(hessian)
        if abs(values[0]) > 1e-9 * values[-1]:
            assert (status == OPTIMAL) == (values[0] > 0.0)
        if status == OPTIMAL:
            convex += 1
            exact = -np.linalg.solve(hessian, gradient)
            size, worst = np.abs(exact).max(), values[-1] / values[0]
            assert changes.ravel() == pytest.approx(exact, abs=1e-13 * worst * size)
            assert minimum == pytest.approx(0.5 * gradient @ exact, rel=1e-9)
    assert convex >= 5


def test_bounds_out_of_the_way_change_nothing(monkeypatch):
    rng = np.random.default_rng(7)
    for _ in range(20):
        expansion = program(rng, 3)
        wide = room(expansion, WIDE)
        daqp = minimise_within(expansion, 0.0, 1e-3, *wide)
        free = minimise_freely(expansion, 0.0, 1e-3)
        assert daqp[0] == free[0] == OPTIMAL
        assert daqp[1] == pytest.approx(free[1], abs=1e-6)
        assert daqp[2] == pytest.approx(free[2], rel=1e-6)
        assert minimise(expansion, 0.0, 1e-3, *wide)[1] == pytest.approx(free[1], abs=1e-6)


@pytest.mark.parametrize("short", [0, 1000])
def test_within_bounds_no_feasible_direction_descends(short, monkeypatch):
    monkeypatch.setattr(qp, "_SHORT", short)
    rng = np.random.default_rng(8)
    active = 0
    for _ in range(30):
        expansion = program(rng, 4)
        lower, upper = room(expansion, 1.0)
        lower, upper = (bound * rng.uniform(0.005, 0.2, bound.shape) for bound in (lower, upper))
        status, changes, minimum = minimise(expansion, 0.0, 1e-3, lower, upper)
        assert status == OPTIMAL
        moves = np.diff(changes, axis=0, prepend=0.0)
        both = np.stack([changes, moves])
        assert np.all((both >= lower - 2e-6) & (both <= upper + 2e-6))
        active += bool(np.any((both < lower + 1e-5) | (both > upper - 1e-5)))
        hessian, gradient = condensed(expansion, 0.0, 1e-3)
        x = changes.ravel()
        assert minimum == pytest.approx(0.5 * x @ hessian @ x + gradient @ x, rel=1e-6)
        slope = (hessian @ x + gradient).reshape(changes.shape)
        for _ in range(20):
            other = rng.uniform(lower[0], upper[0])
            turns = np.diff(other, axis=0, prepend=0.0)
            limit = np.where(turns > 0, upper[1], lower[1]) / np.where(turns == 0, 1.0, turns)
            other *= min(1.0, float(limit[turns != 0].min()))
            assert np.sum(slope * (other - changes)) >= -2e-6 * np.abs(slope).sum()
    assert active > 10


@pytest.mark.parametrize("solve", [solved, solved_by_loops])
def test_symmetric_systems_are_solved_and_definiteness_agrees_with_the_eigenvalues(solve):
    rng = np.random.default_rng(2)
    for _ in range(200):
        n = int(rng.integers(1, 10))
        factor, right = rng.normal(size=(n, n)), rng.normal(size=(n, n + 4))
        shift = 10.0 ** rng.uniform(-6, 1) * rng.choice([-1, 1])
        symmetric = factor + factor.T
        matrix = symmetric + (shift - np.linalg.eigvalsh(symmetric)[0]) * np.eye(n)
        is_definite, solution = solve(matrix.copy(), right.copy())
        assert is_definite == (shift > 0)
        if is_definite:
            assert matrix @ solution == pytest.approx(right, abs=1e-12 * np.abs(solution).max())


def test_contradicting_bounds_are_refused():
    expansion = program(np.random.default_rng(3), 3)
    lower, upper = room(expansion, 1.0)
    # A change from step to step of 3 does not fit between angles of -1 and 1.
    lower[1, 1], upper[1, 1] = 3.0, 4.0
    assert minimise(expansion, 0.0, 1e-3, lower, upper)[0] == FAILED


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("short", [0, 1000])
def test_numbers_that_are_not_finite_are_refused(bad, short, monkeypatch):
    monkeypatch.setattr(qp, "_SHORT", short)
    expansion = program(np.random.default_rng(4), 3)
    expansion.residuals[1, 0] = bad
    with np.errstate(invalid="ignore", over="ignore"):
        status, _, _ = minimise(expansion, 1.0, 0.0, *room(expansion, WIDE))
    assert status in (FAILED, NOT_CONVEX)
