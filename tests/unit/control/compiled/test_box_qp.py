"""The compiled active-set method against DAQP."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.box_qp import solve_box_qp as solve_by_daqp
from ccr_host.control.compiled.box_qp import FAILED, NOT_CONVEX, OPTIMAL, solve_box_qp


def loose(rng, n, scale):
    return -scale * rng.uniform(size=2 * n), scale * rng.uniform(size=2 * n)


def even(rng, n, scale):
    return np.full(2 * n, -scale), np.full(2 * n, scale)


def starting_on_bounds(rng, n, scale):
    lower, upper = loose(rng, n, scale)
    lower[rng.random(2 * n) < 0.3] = 0.0
    upper[rng.random(2 * n) < 0.3] = 0.0
    return lower, upper


def meeting_in_corners(rng, n, scale):
    """Steps of the full bound end on the limit of the angle: more bounds meet than directions."""
    upper = np.concatenate([scale * np.repeat(np.arange(1.0, n // 2 + 1), 2), np.full(n, scale)])
    return -upper, upper


@pytest.mark.long
@pytest.mark.parametrize("bounds", [loose, even, starting_on_bounds, meeting_in_corners])
def test_minimiser_is_that_of_daqp_within_its_tolerance(bounds):
    rng = np.random.default_rng(1)
    active = 0
    for _ in range(300):
        n = 2 * int(rng.integers(1, 12))
        factor = rng.normal(size=(n, n))
        hessian = factor @ factor.T + 10.0 ** rng.uniform(-4, 1) * np.eye(n)
        gradient = 10.0 ** rng.uniform(-2, 3) * rng.normal(size=n)
        rows = np.eye(n) - np.eye(n, k=-2)
        lower, upper = bounds(rng, n, 10.0 ** rng.uniform(-3, 1))
        status, step, minimum = solve_box_qp(hessian, gradient, lower, upper)
        assert status == OPTIMAL
        expected, expected_minimum = solve_by_daqp(hessian, gradient, rows, lower, upper)
        assert step == pytest.approx(expected, abs=2e-6)
        assert minimum == pytest.approx(0.5 * step @ hessian @ step + gradient @ step, rel=1e-8)
        # DAQP may reach 1e-6 beyond the bounds; ours may not.
        assert minimum <= expected_minimum + 1e-5 * np.abs(gradient).sum() + 1e-9
        values = np.concatenate([step, rows @ step])
        beyond = np.maximum(lower - values, values - upper).max()
        assert beyond <= 1e-12 * np.abs(upper).max()
        active += beyond > -1e-12
    assert active > 150


def test_definiteness_is_judged_by_the_whole_hessian():
    rng = np.random.default_rng(2)
    for _ in range(200):
        factor = rng.normal(size=(6, 6))
        symmetric = factor + factor.T
        shift = 10.0 ** rng.uniform(-6, 1) * rng.choice([-1, 1])
        hessian = symmetric + (shift - np.linalg.eigvalsh(symmetric)[0]) * np.eye(6)
        status, _, _ = solve_box_qp(hessian, np.ones(6), -np.ones(12), np.ones(12))
        assert status == (OPTIMAL if shift > 0 else NOT_CONVEX)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    wide = np.full(4, 1.0)
    status, _, _ = solve_box_qp(np.eye(2), np.array([bad, 1.0]), -wide, wide)
    assert status == FAILED
    status, _, _ = solve_box_qp(np.full((2, 2), bad), np.ones(2), -wide, wide)
    assert status in (NOT_CONVEX, FAILED)
