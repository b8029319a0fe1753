"""The product: as it is, and with other QP solvers in place of DAQP."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bench.peers.mpc.problem import Array
from ccr_host.control import sqp
from ccr_host.control.base import Command, Observation
from ccr_host.control.box_qp import NotConvexError, QpError, solve_box_qp_with_piqp
from ccr_host.control.mpc import ModelPredictive
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference

QpSolver = Callable[[Array, Array, Array, Array, Array], tuple[Array, float]]
TOLERANCE = 1e-8


class Ours:
    """The controller ``mpc`` through its interface."""

    def __init__(self, description: Description, reference: Reference) -> None:
        self._controller = ModelPredictive(description)
        self._controller.start(reference)

    def step(self, observation: Observation) -> Command:
        return self._controller.step(observation)

    def plan(self) -> Array:
        return self._controller.plan_rad


class OtherQp(Ours):
    """The same SQP, its QPs solved by someone else."""

    def __init__(self, description: Description, reference: Reference, solver: QpSolver) -> None:
        super().__init__(description, reference)
        self._solver = solver

    def step(self, observation: Observation) -> Command:
        own, sqp.solve_box_qp = sqp.solve_box_qp, self._solver
        try:
            return super().step(observation)
        finally:
            sqp.solve_box_qp = own


def piqp() -> QpSolver:
    """PIQP, dense; the tested alternative of the product."""
    import piqp  # noqa: F401 - here rather than in the first step, if it is missing

    return solve_box_qp_with_piqp


def osqp() -> QpSolver:
    """OSQP, set up again with all of its sparsity."""
    import osqp as package
    from scipy import sparse

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> tuple[Array, float]:
        _refuse_indefinite(h)
        solver: Any = package.OSQP()
        constraints = sparse.csc_matrix(np.vstack([np.eye(len(g)), rows]))
        options = {"eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "verbose": False}
        hessian = sparse.csc_matrix(np.triu(h))
        solver.setup(hessian, g, constraints, lower, upper, max_iter=20_000, **options)
        result = solver.solve(raise_error=False)
        return _checked(result.x, h, g)

    return solve


def clarabel() -> QpSolver:
    """Clarabel, an interior-point method in Rust."""
    import clarabel as package
    from scipy import sparse

    settings = package.DefaultSettings()
    settings.verbose = False

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> tuple[Array, float]:
        _refuse_indefinite(h)
        both = np.vstack([np.eye(len(g)), rows])
        constraints = sparse.csc_matrix(np.vstack([both, -both]))
        cones = [package.NonnegativeConeT(2 * len(both))]
        room = np.concatenate([upper, -lower])
        hessian = sparse.csc_matrix(np.triu(h))
        solver = package.DefaultSolver(hessian, g, constraints, room, cones, settings)
        return _checked(np.array(solver.solve().x), h, g)

    return solve


def proxqp() -> QpSolver:
    """ProxQP, dense."""
    from proxsuite import proxqp as package

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> tuple[Array, float]:
        _refuse_indefinite(h)
        both = np.vstack([np.eye(len(g)), rows])
        solver = package.dense.QP(len(g), 0, len(both))
        solver.settings.eps_abs = TOLERANCE
        solver.init(h, g, None, None, both, lower, upper)
        solver.solve()
        return _checked(np.array(solver.results.x), h, g)

    return solve


def _refuse_indefinite(hessian: Array) -> None:
    try:
        np.linalg.cholesky(hessian)
    except np.linalg.LinAlgError:
        raise NotConvexError("the Hessian is not positive definite") from None


def _checked(x: Array, hessian: Array, gradient: Array) -> tuple[Array, float]:
    minimum = float(0.5 * x @ hessian @ x + gradient @ x)
    if not np.isfinite(minimum):
        raise QpError("no solution")
    return x, minimum
