"""One convex quadratic program between bounds.

Everything else in the package sees only ``solve_box_qp``. DAQP was the fastest packaged solver on
this problem and never failed, but it has one maintainer; PIQP is the alternative, held to the
same answers by the tests.
"""

from __future__ import annotations

import math

import daqp
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_DAQP_OPTIMAL = 1
_DAQP_NOT_CONVEX = -5


class QpError(Exception):
    """The program has no solution, or the solver found none."""


class NotConvexError(QpError):
    """The Hessian is not positive definite."""


def solve_box_qp(
    hessian: FloatArray,
    gradient: FloatArray,
    rows: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[FloatArray, float]:
    """Minimise x' H x / 2 + g' x between bounds on x and on ``rows`` @ x.

    Args:
        hessian: (n, n), positive definite.
        gradient: (n,).
        rows: (m, n), m may be 0.
        lower: (n + m,), bounds of x first, then those of the rows.
        upper: (n + m,).

    Returns:
        The minimiser, (n,), and the minimum; both finite.

    Raises:
        NotConvexError: the Hessian is not positive definite.
        QpError: infeasible, or not finite.
    """
    # eps_prox = 0: DAQP's own Cholesky shall refuse an indefinite Hessian, not repair it.
    solution, minimum, exit_flag, _ = daqp.solve(
        hessian, gradient, rows, upper, lower, eps_prox=0.0
    )
    if exit_flag == _DAQP_NOT_CONVEX:
        raise NotConvexError("the Hessian is not positive definite")
    # DAQP passes NaN through and calls it optimal.
    if exit_flag != _DAQP_OPTIMAL or not math.isfinite(minimum):
        raise QpError(f"DAQP ended with flag {exit_flag} and minimum {minimum}")
    return solution, minimum


def solve_box_qp_with_piqp(
    hessian: FloatArray,
    gradient: FloatArray,
    rows: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[FloatArray, float]:
    """The same by PIQP (an optional dependency), an interior-point method."""
    import piqp  # noqa: PLC0415 - optional

    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        raise NotConvexError("the Hessian is not positive definite") from None
    n = len(gradient)
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-10
    solver.settings.eps_rel = 1e-10
    solver.setup(hessian, gradient, None, None, rows, lower[n:], upper[n:], lower[:n], upper[:n])
    if solver.solve() != piqp.PIQP_SOLVED:
        raise QpError(f"PIQP ended with {solver.result.info.status}")
    return np.array(solver.result.x), float(solver.result.info.primal_obj)
