"""The optimisation problem of the MPC, (14)-(15): cost, gradient and exact Hessian.

Unknowns are the motor angles q_1..q_M to be commanded next rather than their increments
u_j = q_j - q_(j-1): the same problem by (13), but motor limits become plain bounds. Prediction
errors are

    e_k = f_m - f_k + sum over j <= k of J(q_(j-1)) u_j,        k = 1..M,

and the cost is Q sum |e_k|^2 + R sum |u_j|^2. J is evaluated at the pose where its increment
begins, so the first one refers to the measured pose, as in (12); (13) and (14) print the same
index for the pose before and after a move. (15) counts N terms from k = 0; the one at k = 0
contains only the measurement, so M = N - 1 increments are free and the last is zero.

``by_model`` is the same problem with e_k = f(q_k) + d - f_k, for a controller that estimates a
disturbance d against the model, which must not include the linearisation error of (14)'s sums.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Robot
from ccr_host.robot.kinematics import (
    Chain,
    ConstantCurvature,
    IntArray,
    chosen,
    derivative_index,
    jets,
    products,
)

FloatArray = NDArray[np.float64]


class Weights(NamedTuple):
    """The weights Q (1/mm^2) and R (1/rad^2) of (15)."""

    position: float
    effort: float


class Constants(NamedTuple):
    """What the problems of a run have in common; n motors, D degrees of freedom."""

    weights: Weights
    by_model: bool
    """Whether e_k is predicted by f(q_k) instead of (14)'s sum."""
    chain: Chain
    both: FloatArray
    """``chain.bending`` for two poses at once, (2n, 2D)."""
    second: IntArray
    """Where the jets have the second derivatives, (D^2,)."""
    third: IntArray
    """Likewise, (D^3,)."""
    transition: FloatArray
    """The constant entries of ``Expansion.transitions``, (n + 4, 2n + 4)."""
    residual: FloatArray
    """The constant entries of ``Expansion.residuals``, (2n + 4, 3 + n)."""

    @classmethod
    def of(cls, robot: Robot, weights: Weights, *, by_model: bool = False) -> Constants:
        """The constants for a described robot."""
        chain = ConstantCurvature(robot).chain()
        n, freedoms = chain.bending.shape
        both = np.asarray(np.kron(np.eye(2), chain.bending), dtype=np.float64)
        transition, residual = np.zeros((n + 4, 2 * n + 4)), np.zeros((2 * n + 4, 3 + n))
        transition[:n, :n], transition[n + 3, 2 * n + 3] = np.eye(n), 1.0
        residual[:n, 3:] = math.sqrt(2.0 * weights.effort) * np.eye(n)
        residual[n : 2 * n, 3:] = -residual[:n, 3:]
        if not by_model:
            transition[n : n + 3, 2 * n : 2 * n + 3] = np.eye(3)
            residual[2 * n : 2 * n + 3, :3] = math.sqrt(2.0 * weights.position) * np.eye(3)
        return cls(
            weights,
            by_model,
            chain,
            both,
            derivative_index(freedoms, 2),
            derivative_index(freedoms, 3),
            transition,
            residual,
        )


class Tracking(NamedTuple):
    """An instance of the problem: where the robot is and where it should be."""

    constants: Constants
    start_rad: FloatArray
    """q_0, the last commanded angles, (n,)."""
    offsets_mm: FloatArray
    """f_m - f_k for k = 1..M, (M, 3), the errors without any motion; ``by_model`` d - f_k."""


class Rollout(NamedTuple):
    """The prediction (14) for one choice of angles, and its cost (15)."""

    angles: FloatArray
    """(M, n)."""
    moves_rad: FloatArray
    """Increments, (M, n)."""
    jets: FloatArray
    """The model at the poses where the moves begin, (M, K, 3); ``by_model`` where they end."""
    errors_mm: FloatArray
    """(M, 3)."""
    cost: float


class Expansion(NamedTuple):
    """The second-order expansion of the cost, stage by stage.

    The unknowns of a stage are z = (dq_j, dq_(j-1), de_(j-1), 1), 2n + 4 numbers; its outcome is
    (dq_j, de_j, 1). It adds to the cost half the squared residuals, which are linear in z, and
    z' C z / 2.
    """

    transitions: FloatArray
    """Outcome over z, (M, n + 4, 2n + 4)."""
    residuals: FloatArray
    """sqrt(2 Q) e_j and sqrt(2 R) u_j over z, transposed, (M, 2n + 4, 3 + n)."""
    curvature: FloatArray
    """C, in the angles alone, (M, 2n, 2n)."""


def roll_out(problem: Tracking, angles: FloatArray) -> Rollout:
    """Predict the tip for commanded angles, (M, n), and the cost."""
    constants, start_rad, offsets_mm = problem
    weights, chain, by_model = constants.weights, constants.chain, constants.by_model
    steps, freedoms = len(angles), chain.bending.shape[1]
    before = np.empty_like(angles)
    before[0], before[1:] = start_rad, angles[:-1]
    moves = angles - before
    jet = jets(chain, products(angles if by_model else before, chain.bending))
    if by_model:
        errors = offsets_mm + jet[:, 0]
    else:
        bends = products(moves, chain.bending).reshape(steps, 1, freedoms)
        moved = products(bends, jet[:, 1 : freedoms + 1])
        errors = offsets_mm + accumulated(moved.reshape(steps, 3))
    cost = weights.position * squared(errors) + weights.effort * squared(moves)
    return Rollout(angles, moves, jet, errors, cost)


def expand(problem: Tracking, rollout: Rollout) -> Expansion:
    """Expand the cost at a rollout.

    With w_j = J(q_(j-1)) u_j, the errors follow from e_j = e_(j-1) + w_j. So the curvature of w_j
    counts as often as it enters an error: times the costate 2 Q (e_j + ... + e_M).
    """
    weights, by_model, chain, both, seconds, thirds, transition, residual = problem.constants
    _, moves, jet, errors, _ = rollout
    (steps, n), freedoms = moves.shape, chain.bending.shape[1]
    twice_q, twice_r = 2.0 * weights.position, 2.0 * weights.effort
    costates = twice_q * (errors if by_model else accumulated(errors[::-1])[::-1])
    pulled = products(jet, costates.reshape(steps, 3, 1))
    second = chosen(pulled, seconds).reshape(steps, freedoms, freedoms)
    # By the bending of a stage's pose, then by that of the pose before.
    effect = np.zeros((steps, 2 * freedoms, 3))
    bent = np.zeros((steps, 2 * freedoms, 2 * freedoms))
    effect[:, :freedoms] = slope = jet[:, 1 : freedoms + 1]
    if by_model:
        bent[:, :freedoms, :freedoms] = second
    else:
        bends = products(moves, chain.bending).reshape(steps, 1, freedoms)
        turning = products(bends, chosen(jet, seconds).reshape(steps, freedoms, 3 * freedoms))
        third = products(bends, chosen(pulled, thirds).reshape(steps, freedoms, -1))
        effect[:, freedoms:] = turning.reshape(steps, freedoms, 3) - slope
        bent[:, :freedoms, freedoms:] = second
        bent[:, freedoms:, :freedoms] = second
        bent[:, freedoms:, freedoms:] = third.reshape(steps, freedoms, freedoms) - 2.0 * second
    by_angles = products(both, effect)
    transitions = np.empty((steps, n + 4, 2 * n + 4))
    transitions[:] = transition
    transitions[:, n : n + 3, : 2 * n] = by_angles.transpose(0, 2, 1)
    residuals = np.empty((steps, 2 * n + 4, 3 + n))
    residuals[:] = residual
    residuals[:, : 2 * n, :3] = math.sqrt(twice_q) * by_angles
    residuals[:, 2 * n + 3, :3] = math.sqrt(twice_q) * errors
    residuals[:, 2 * n + 3, 3:] = math.sqrt(twice_r) * moves
    return Expansion(transitions, residuals, products(products(both, bent), both.T))


def accumulated(rows: FloatArray) -> FloatArray:
    """Sum of each row and all before it, (N, k)."""
    return np.add.accumulate(rows)


def squared(numbers: FloatArray) -> float:
    """Sum of squares of any array."""
    flat = numbers.ravel()
    return float(np.dot(flat, flat))
