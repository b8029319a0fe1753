"""Against scipy, with and without bounds and a Jacobian of one's own."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from ccr_host.tracking.least_squares import minimise

TIMES = np.linspace(0.0, 3.0, 20)
SEEN = 2.0 * np.exp(-0.7 * TIMES) + 0.1 * np.sin(9.0 * TIMES)
START = np.array([1.0, 0.1])


def residuals(unknowns):
    return unknowns[0] * np.exp(-unknowns[1] * TIMES) - SEEN


def jacobian(unknowns):
    decay = np.exp(-unknowns[1] * TIMES)
    return np.stack([decay, -unknowns[0] * TIMES * decay], axis=1)


@pytest.mark.parametrize("own", [{}, {"jacobian": jacobian}], ids=["differences", "own jacobian"])
def test_the_minimum_is_that_of_scipy(own) -> None:
    found, witness = minimise(residuals, START, **own), least_squares(residuals, START)
    np.testing.assert_allclose(found.unknowns, witness.x, rtol=1e-5)
    assert found.cost() == pytest.approx(2.0 * witness.cost)
    covariance = np.linalg.inv(witness.jac.T @ witness.jac)
    np.testing.assert_allclose(found.standard_deviations(), np.sqrt(np.diag(covariance)), rtol=1e-3)


@pytest.mark.parametrize("most", [(1.5, 9.0), (9.0, 0.4), (1.5, 0.4)])
def test_no_unknown_leaves_its_bounds(most) -> None:
    found = minimise(residuals, START, upper=np.array(most))
    witness = least_squares(residuals, START, bounds=(-np.inf, most))
    assert np.all(found.unknowns <= most)
    np.testing.assert_allclose(found.unknowns, witness.x, rtol=1e-4)
    assert found.cost() == pytest.approx(2.0 * witness.cost, rel=1e-6)


def test_a_coarser_end_is_sooner() -> None:
    calls = []

    def counted(unknowns):
        calls.append(unknowns)
        return residuals(unknowns)

    minimise(counted, START, jacobian=jacobian)
    fine = len(calls)
    calls.clear()
    minimise(counted, START, jacobian=jacobian, converged=0.1)
    assert len(calls) < fine
