"""The product: as it is, and with other QP solvers in place of DAQP."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bench.peers.mpc.problem import Array
from ccr_host.control.base import Command, Observation
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.controller import ModelPredictive
from ccr_host.control.mpc.problem import Expansion
from ccr_host.control.mpc.qp import FAILED, NOT_CONVEX, OPTIMAL, condensed
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference

QpSolver = Callable[[Array, Array, Array, Array, Array], Array]
"""Hessian, gradient, rows, then the bounds of the solution and of the rows times it."""
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
    """The same SQP with another QP solver."""

    def __init__(self, description: Description, reference: Reference, solver: QpSolver) -> None:
        super().__init__(description, reference)
        self._solver = solver

    def step(self, observation: Observation) -> Command:
        own, sqp.minimise = sqp.minimise, self._minimise
        try:
            return super().step(observation)
        finally:
            sqp.minimise = own

    def _minimise(
        self, expansion: Expansion, blend: float, ridge: float, lower: Array, upper: Array
    ) -> tuple[int, Array, float]:
        hessian, gradient = condensed(expansion, blend, ridge)
        _, steps, n = lower.shape
        rows = np.eye(steps * n) - np.eye(steps * n, k=-n)
        try:
            np.linalg.cholesky(hessian)
        except np.linalg.LinAlgError:
            return NOT_CONVEX, lower[0], 0.0
        step = self._solver(hessian, gradient, rows, lower.ravel(), upper.ravel())
        minimum = float(0.5 * step @ hessian @ step + gradient @ step)
        return OPTIMAL if np.isfinite(minimum) else FAILED, step.reshape(steps, n), minimum


def piqp() -> QpSolver:
    """PIQP, dense, an interior-point method."""
    import piqp as package

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> Array:
        n = len(g)
        solver = package.DenseSolver()
        solver.settings.eps_abs = solver.settings.eps_rel = 1e-10
        solver.setup(h, g, None, None, rows, lower[n:], upper[n:], lower[:n], upper[:n])
        solver.solve()
        return np.array(solver.result.x)

    return solve


def osqp() -> QpSolver:
    """OSQP, set up again with all of its sparsity."""
    import osqp as package
    from scipy import sparse

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> Array:
        solver: Any = package.OSQP()
        constraints = sparse.csc_matrix(np.vstack([np.eye(len(g)), rows]))
        options = {"eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "verbose": False}
        hessian = sparse.csc_matrix(np.triu(h))
        solver.setup(hessian, g, constraints, lower, upper, max_iter=20_000, **options)
        result = solver.solve(raise_error=False)
        return result.x

    return solve


def clarabel() -> QpSolver:
    """Clarabel, an interior-point method in Rust."""
    import clarabel as package
    from scipy import sparse

    settings = package.DefaultSettings()
    settings.verbose = False

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> Array:
        both = np.vstack([np.eye(len(g)), rows])
        constraints = sparse.csc_matrix(np.vstack([both, -both]))
        cones = [package.NonnegativeConeT(2 * len(both))]
        room = np.concatenate([upper, -lower])
        hessian = sparse.csc_matrix(np.triu(h))
        solver = package.DefaultSolver(hessian, g, constraints, room, cones, settings)
        return np.array(solver.solve().x)

    return solve


def proxqp() -> QpSolver:
    """ProxQP, dense."""
    from proxsuite import proxqp as package

    def solve(h: Array, g: Array, rows: Array, lower: Array, upper: Array) -> Array:
        both = np.vstack([np.eye(len(g)), rows])
        solver = package.dense.QP(len(g), 0, len(both))
        solver.settings.eps_abs = TOLERANCE
        solver.init(h, g, None, None, both, lower, upper)
        solver.solve()
        return np.array(solver.results.x)

    return solve
