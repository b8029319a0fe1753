"""The QP behind the SQP: DAQP, and machine code's way where no bound is in the way."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.mpc.qp import (
    BOUND,
    FAILED,
    NOT_CONVEX,
    OPTIMAL,
    minimise,
    minimise_without_bounds,
)

BOTH = pytest.mark.parametrize("solve", [minimise, minimise_without_bounds])


def random_program(rng, n=6, room=1.0):
    factor = rng.normal(size=(n, n))
    hessian = factor @ factor.T + 0.1 * np.eye(n)
    upper = room * rng.uniform(0.05, 1.0, 2 * n)
    return hessian, 5.0 * rng.normal(size=n), -upper[::-1], upper


def changes(n):
    return np.eye(n) - np.eye(n, k=-2)


def test_solution_satisfies_the_optimality_conditions():
    rng = np.random.default_rng(0)
    for _ in range(100):
        hessian, gradient, lower, upper = random_program(rng)
        rows = changes(6)
        status, step, minimum = minimise(hessian, gradient, lower, upper)
        assert status == OPTIMAL
        x = np.array(step)
        assert minimum == pytest.approx(0.5 * x @ hessian @ x + gradient @ x, abs=1e-6)
        values = np.concatenate([x, rows @ x])
        assert np.all((values >= lower - 1e-6) & (values <= upper + 1e-6))
        # No feasible direction descends: project many onto the bounds and look.
        slope = hessian @ x + gradient
        for other in _feasible_points(rng, rows, lower, upper):
            assert slope @ (other - x) >= -1e-4


def _feasible_points(rng, rows, lower, upper):
    n = rows.shape[1]
    for _ in range(20):
        point = rng.uniform(-1, 1, n)
        values = np.concatenate([point, rows @ point])
        limit = np.where(values > 0, upper, lower) / np.where(values == 0, 1, values)
        yield point * min(1.0, limit.min())


@BOTH
def test_only_the_upper_triangle_counts(solve):
    hessian, gradient, lower, upper = random_program(np.random.default_rng(3), room=1e6)
    whole = solve(hessian, gradient, lower, upper)
    half = solve(np.triu(hessian), gradient, lower, upper)
    assert half[0] == OPTIMAL
    assert half[1] == pytest.approx(np.array(whole[1]), abs=1e-12)
    assert half[2] == pytest.approx(whole[2], rel=1e-12)


def test_without_a_bound_in_the_way_both_agree_and_otherwise_it_is_told():
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(300):
        n = 2 * int(rng.integers(1, 12))
        program = random_program(rng, n, 10.0 ** rng.uniform(-1, 3))
        _, expected, expected_minimum = minimise(*program)
        status, step, minimum = minimise_without_bounds(*program)
        seen.add(status)
        if status == OPTIMAL:
            assert step == pytest.approx(np.array(expected), abs=1e-6)
            assert minimum == pytest.approx(expected_minimum, rel=1e-6)
        else:
            assert expected_minimum > minimum
    assert seen == {OPTIMAL, BOUND}


@BOTH
def test_definiteness_agrees_with_the_eigenvalues(solve):
    rng = np.random.default_rng(2)
    for _ in range(500):
        factor = rng.normal(size=(6, 6))
        symmetric = factor + factor.T
        shift = 10.0 ** rng.uniform(-6, 1) * rng.choice([-1, 1])
        hessian = symmetric + (shift - np.linalg.eigvalsh(symmetric)[0]) * np.eye(6)
        status, _, _ = solve(hessian, np.ones(6), -np.ones(12), np.ones(12))
        assert (status == NOT_CONVEX) == (shift < 0)


def test_contradicting_bounds_are_refused():
    # x[2] - x[0] cannot be 3 within unit boxes.
    lower, upper = -np.ones(8), np.ones(8)
    lower[6], upper[6] = 3.0, 4.0
    assert minimise(np.eye(4), np.zeros(4), lower, upper)[0] == FAILED


@BOTH
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(solve, bad):
    wide = np.ones(4)
    with np.errstate(invalid="ignore"):
        assert solve(np.eye(2), np.array([bad, 1.0]), -wide, wide)[0] in (FAILED, BOUND)
        assert solve(np.full((2, 2), bad), np.ones(2), -wide, wide)[0] != OPTIMAL
