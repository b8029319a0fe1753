"""The offset-free MPC's problem and its solver.

Unknowns are the motor angles q_1..q_M of the horizon; the cost is

    Q sum |f(q_k) - w_k|^2 + R sum |q_k - q_(k-1)|^2,    w_k: wanted tip less the disturbance,

(15) with the tip from the model itself in place of (14)'s sums of J u: a disturbance estimated
against f must not be joined by what those sums miss.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.box_qp import NotConvexError, QpError, solve_box_qp
from ccr_host.control.nlp import Weights
from ccr_host.control.sqp import Bounds
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]

_MAX_ITERATIONS = 10
_CURVATURE_SHARES = (1.0, 0.0)
"""Exact Hessian, else Gauss-Newton."""
_RIDGE_MM2_RAD2 = 1.0
"""Keeps Gauss-Newton definite at the folds; J'J is about 1e4 elsewhere."""
_MAX_HALVINGS = 6
_CONVERGED_RAD = 1e-4
"""Below a hundredth of a millimetre at the tip."""


class Expansion(NamedTuple):
    """Gradient (2M,), and the two parts of the Hessian (2M, 2M)."""

    gradient: FloatArray
    gauss_newton: FloatArray
    curvature: FloatArray


class OffsetTracking(NamedTuple):
    """One instance: ``start_rad`` (2,) is q_0, ``wanted_mm`` (M, 3)."""

    model: ConstantCurvature
    weights: Weights
    start_rad: FloatArray
    wanted_mm: FloatArray

    def cost(self, angles_rad: FloatArray) -> float:
        """Of angles (M, 2)."""
        error_mm = self.model.tip_mm(angles_rad) - self.wanted_mm
        moves = self._moves(angles_rad)
        squared_error, squared_move = float(np.sum(error_mm**2)), float(moves @ moves)
        return self.weights.position * squared_error + self.weights.effort * squared_move

    def expand(self, angles_rad: FloatArray) -> Expansion:
        """Second order, at angles (M, 2)."""
        twice_q, twice_r = 2.0 * self.weights.position, 2.0 * self.weights.effort
        error_mm = self.model.tip_mm(angles_rad) - self.wanted_mm
        jacobian = self.model.jacobian_mm_rad(angles_rad)
        hessian = self.model.hessian_mm_rad2(angles_rad)
        differences = _differences(len(angles_rad))
        slope = np.einsum("kim,ki->km", jacobian, error_mm).ravel()
        gram = _block_diagonal(np.einsum("kim,kin->kmn", jacobian, jacobian))
        bend = _block_diagonal(np.einsum("ki,kimn->kmn", error_mm, hessian))
        return Expansion(
            twice_q * slope + twice_r * differences.T @ self._moves(angles_rad),
            twice_q * gram + twice_r * differences.T @ differences,
            twice_q * bend,
        )

    def _moves(self, angles_rad: FloatArray) -> FloatArray:
        moves: FloatArray = np.diff(angles_rad, axis=0, prepend=self.start_rad[None]).ravel()
        return moves


def solve(
    problem: OffsetTracking, limits: MotorLimits, step_bound_rad: float, guess_rad: FloatArray
) -> FloatArray:
    """Angles (M, 2) within limits and step bounds that cost no more than the guess, made feasible.

    Where the QP solver fails the best angles so far are the answer.
    """
    bounds = Bounds(limits.lower_rad, limits.upper_rad, step_bound_rad)
    angles_rad = _feasible(problem, bounds, guess_rad)
    cost = problem.cost(angles_rad)
    for _ in range(_MAX_ITERATIONS):
        step_rad = _newton_step(problem, bounds, angles_rad)
        if step_rad is None:
            break
        for halving in range(_MAX_HALVINGS):
            candidate_rad = _feasible(problem, bounds, angles_rad + 0.5**halving * step_rad)
            candidate_cost = problem.cost(candidate_rad)
            if candidate_cost < cost:
                break
        else:
            break
        moved_rad = float(np.abs(candidate_rad - angles_rad).max())
        angles_rad, cost = candidate_rad, candidate_cost
        if moved_rad < _CONVERGED_RAD:
            break
    return angles_rad


def _newton_step(
    problem: OffsetTracking, bounds: Bounds, angles_rad: FloatArray
) -> FloatArray | None:
    gradient, gauss_newton, curvature = problem.expand(angles_rad)
    rows, lower, upper = bounds.over(len(angles_rad))
    moves = np.diff(angles_rad, axis=0, prepend=problem.start_rad[None])
    now = np.concatenate([angles_rad.ravel(), moves.ravel()])
    ridge = _RIDGE_MM2_RAD2 * problem.weights.position * np.eye(len(gradient))
    for share in _CURVATURE_SHARES:
        hessian = gauss_newton + share * curvature + ridge
        try:
            step, _ = solve_box_qp(hessian, gradient, rows, lower - now, upper - now)
        except NotConvexError:
            continue
        except QpError:
            return None
        return step.reshape(-1, 2)
    return None


def _feasible(problem: OffsetTracking, bounds: Bounds, angles_rad: FloatArray) -> FloatArray:
    first, second = problem.start_rad.tolist()
    pairs = [(a, b) for a, b in angles_rad.tolist()]
    inside = bounds.feasible((first, second), pairs)
    return np.fromiter(chain(*inside), dtype=np.float64).reshape(-1, 2)


def _block_diagonal(blocks: FloatArray) -> FloatArray:
    """(M, 2, 2) -> (2M, 2M)."""
    steps = len(blocks)
    matrix = np.zeros((steps, 2, steps, 2))
    matrix[np.arange(steps), :, np.arange(steps), :] = blocks
    return matrix.reshape(2 * steps, 2 * steps)


@lru_cache(maxsize=128)
def _differences(steps: int) -> FloatArray:
    return np.eye(2 * steps) - np.eye(2 * steps, k=-2)
