"""The QP solver behind the SQP, and its alternative."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.box_qp import NotConvexError, QpError, solve_box_qp, solve_box_qp_with_piqp

BOTH = pytest.mark.parametrize("solve", [solve_box_qp, solve_box_qp_with_piqp])


def random_program(rng, n=6):
    factor = rng.normal(size=(n, n))
    hessian = factor @ factor.T + 0.1 * np.eye(n)
    rows = np.eye(n) - np.eye(n, k=-2)
    upper = rng.uniform(0.05, 1.0, 2 * n)
    return hessian, 5.0 * rng.normal(size=n), rows, -upper[::-1], upper


@BOTH
def test_solution_satisfies_the_optimality_conditions(solve):
    rng = np.random.default_rng(0)
    for _ in range(100):
        hessian, gradient, rows, lower, upper = random_program(rng)
        x, minimum = solve(hessian, gradient, rows, lower, upper)
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


def test_both_solvers_agree():
    rng = np.random.default_rng(1)
    for _ in range(200):
        program = random_program(rng)
        first, _ = solve_box_qp(*program)
        second, _ = solve_box_qp_with_piqp(*program)
        assert first == pytest.approx(second, abs=1e-5)


@BOTH
def test_without_rows_it_is_a_plain_box(solve):
    x, _ = solve(np.eye(2), np.array([-3.0, 0.5]), np.zeros((0, 2)), -np.ones(2), np.ones(2))
    assert x == pytest.approx([1.0, -0.5], abs=1e-6)


@BOTH
def test_indefinite_hessian_is_refused(solve):
    program = (np.diag([1.0, -1.0]), np.zeros(2), np.zeros((0, 2)), -np.ones(2), np.ones(2))
    with pytest.raises(NotConvexError):
        solve(*program)


def test_definiteness_agrees_with_the_eigenvalues():
    rng = np.random.default_rng(2)
    for _ in range(500):
        factor = rng.normal(size=(6, 6))
        symmetric = factor + factor.T
        shift = 10.0 ** rng.uniform(-6, 1) * rng.choice([-1, 1])
        hessian = symmetric + (shift - np.linalg.eigvalsh(symmetric)[0]) * np.eye(6)
        program = (hessian, np.ones(6), np.zeros((0, 6)), -np.ones(6), np.ones(6))
        if shift > 0:
            solve_box_qp(*program)
        else:
            with pytest.raises(NotConvexError):
                solve_box_qp(*program)


@BOTH
def test_contradicting_bounds_are_refused(solve):
    rows = np.array([[1.0, 1.0]])
    lower, upper = np.array([-1.0, -1.0, 3.0]), np.array([1.0, 1.0, 4.0])
    with pytest.raises(QpError):
        solve(np.eye(2), np.zeros(2), rows, lower, upper)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    with pytest.raises(QpError):
        solve_box_qp(np.eye(2), np.array([bad, 1.0]), np.zeros((0, 2)), -np.ones(2), np.ones(2))
