"""The optimisation problem of the MPC, (14)-(15): cost, gradient and exact Hessian.

Unknowns are the motor angles q_1..q_M to be commanded next rather than their increments
u_j = q_j - q_(j-1): the same problem by (13), but motor limits become plain bounds. Prediction
errors are

    e_k = f_m - f_k + sum over j <= k of J(q_(j-1)) u_j,        k = 1..M,

and the cost is Q sum |e_k|^2 + R sum |u_j - v_j|^2, where v is 0 in the paper. J is
evaluated at the pose where its increment begins, so the first one refers to the measured pose, as
in (12); (13) and (14) print the same index for the pose before and after a move. (15) counts N
terms from k = 0; the one at k = 0 contains only the measurement, so M = N - 1 increments are free
and the last is zero.

A robot may have motors that the tip does not need, and folds within its path. There (15)
lets the angles drift where they do not move the tip, and winds them up where they hardly do, until
J no longer is that of the robot. So v is the motion of the path's nearest reachable configurations
and part of the way back to them, and J is that of the bending that the robot shows, see
``controller.py``. ``control.bending = "commanded"`` leaves (15) as printed.

``by_model`` is the same problem with e_k = f(q_k) + d - f_k, for a controller that estimates a
disturbance d against the model, which must not include the linearisation error of (14)'s sums.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ccr_host.core.arrays import Array, IntArray
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import (
    Chain,
    ConstantCurvature,
    chosen,
    jet_index,
    jets,
    products,
)

_PAPERS_EFFORT = 0.5
_STIFFNESS = 0.2
"""Square root of R / Q, in shares of the tip's motion by a radian: where the tip
moves less than this, motors follow the path rather than the tip."""
_RETURN = 0.2
"""Share of the way back to the path's configurations in one increment. 0.1 to 0.4 above, and 0.2 to
0.5 here, make 0.03 mm on ``three-spatial`` at 10, 20 and 40 Hz (with an earlier filter)."""


class Weights(NamedTuple):
    """The weights Q (1/mm^2) and R (1/rad^2) of (15)."""

    position: float
    effort: float
    returns: float = 0.0
    """Share of the way back to the path's configurations that an increment may have without effort;
    0 if every increment is an effort, as in (15)."""

    @classmethod
    def papers(cls, position: float, effort: float | None) -> Weights:
        """Every increment is an effort; R is the paper's unless given."""
        return cls(position, _PAPERS_EFFORT if effort is None else effort)

    @classmethod
    def of(cls, description: Description) -> Weights:
        """Those of a description: the paper's, or some that suit the robot's size."""
        control = description.control
        position, effort = control.position_weight, control.effort_weight
        if control.bending == "commanded":
            return cls.papers(position, effort)
        if effort is None:
            model = ConstantCurvature(description.robot)
            lateral = model.jacobian_mm_rad(np.zeros(model.motors))
            effort = position * _STIFFNESS**2 * squared(lateral) / 2.0
        return cls(position, effort, _RETURN)


def free_moves_rad(weights: Weights, path_rad: Array, commanded_rad: Array) -> Array:
    """Increments that are no effort, v_1..v_M, (M, n).

    Args:
        weights: of (15).
        path_rad: the path's configurations, of the step before the first one on, (M + 1, n).
        commanded_rad: last command, (n,).
    """
    moves = path_rad[1:] - path_rad[:-1]
    if weights.returns == 0.0:
        return np.zeros_like(moves)
    moves[0] += weights.returns * (path_rad[0] - commanded_rad)
    return moves


class Constants(NamedTuple):
    """What the problems of a run have in common; n motors, D degrees of freedom.

    K is the number of a pose's derivatives up to the second order, see ``jet_index``.
    """

    weights: Weights
    sizes: Array
    """sqrt(2 Q), three times, and sqrt(2 R), n times: what residuals are over errors and moves."""
    by_model: bool
    """Whether e_k is predicted by f(q_k) instead of (14)'s sum."""
    chain: Chain
    further: IntArray
    """Where the jets have each derivative up to the second order, differentiated once more by each
    coordinate, (D K,)."""
    effect: Array
    """sqrt(2 Q) times what J and its change along a move count by q_j and by q_(j-1), (2, 2)."""
    bend: Array
    """Likewise what the second derivatives and their change count by both of these, (4, 2)."""
    square: Array
    """The second derivatives by the motor angles over a pose's, transposed, (K, n^2)."""
    transition: Array
    """The constant entries of a stage's outcome (dq_j, de_j, 1) over z = (dq_j, dq_(j-1), de_(j-1),
    1), with errors e in shares of sqrt(2 Q), (n + 4, 2n + 4)."""
    linear: Array
    """The constant entries of a stage's residuals over z, transposed, (2n + 4, 3 + n)."""

    @classmethod
    def of(cls, robot: Robot, weights: Weights, *, by_model: bool = False) -> Constants:
        """The constants for a described robot."""
        model = ConstantCurvature(robot)
        chain = model.chain()
        freedoms = chain.bending.shape[1]
        index = jet_index(freedoms)
        once_more = [
            index[tuple(sorted((*derivative, y)))]
            for y in range(freedoms)
            for derivative in jet_index(freedoms, 2)
        ]
        n, size = len(chain.bending), math.sqrt(2.0 * weights.position)
        sizes = np.repeat([size, math.sqrt(2.0 * weights.effort)], [3, n])
        transition, linear = np.zeros((n + 4, 2 * n + 4)), np.zeros((2 * n + 4, 3 + n))
        transition[:n, :n], transition[n + 3, 2 * n + 3] = np.eye(n), 1.0
        linear[:n, 3:] = np.diag(sizes[3:])
        linear[n : 2 * n, 3:] = -linear[:n, 3:]
        effect = [[1.0, 0.0], [0.0, 0.0]] if by_model else [[1.0, 0.0], [-1.0, 1.0]]
        bend = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [-2.0, 1.0]]
        if by_model:
            bend = [[1.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]
        else:
            transition[n : n + 3, 2 * n : 2 * n + 3] = np.eye(3)
            linear[2 * n : 2 * n + 3, :3] = np.eye(3)
        return cls(
            weights,
            sizes,
            by_model,
            chain,
            np.array(once_more, dtype=np.int64),
            size * np.array(effect),
            size * np.array(bend),
            np.ascontiguousarray(model.by_motors[1 + n :].T),
            transition,
            linear,
        )


class Tracking(NamedTuple):
    """An instance of the problem: where the robot is and where it should be."""

    constants: Constants
    start_rad: Array
    """q_0, the last commanded angles, (n,)."""
    offsets_mm: Array
    """f_m - f_k for k = 1..M, (M, 3), the errors without any motion; ``by_model`` d - f_k."""
    free_rad: Array
    """v of the cost, see ``free_moves_rad``."""
    extra_rad: Array
    """Motor angles that would bend the model as the robot is bent beyond its commands, (n,): the
    model's configuration is the angles and these."""


class Rollout(NamedTuple):
    """The prediction (14) for one choice of angles, and its cost (15)."""

    angles: Array
    """(M, n)."""
    moves_rad: Array
    """Increments, (M, n)."""
    turns_rad: Array
    """Increments of the bending, (M, 1, D)."""
    jets: Array
    """The model at the poses where the moves begin, or ``by_model`` where they end."""
    errors_mm: Array
    """(M, 3)."""
    residuals: Array
    """sqrt(2 Q) e_j and sqrt(2 R) (u_j - v_j), (M, 3 + n)."""
    cost: float
    """Half the sum of their squares."""


class Expansion(NamedTuple):
    """The second-order expansion of the cost.

    The cost is half the sum of the squared residuals, which depend on the angles linearly, and of
    the curvature's quadratic form.
    """

    constants: Constants
    residuals: Array
    """Those of the rollout that was expanded, (M, 3 + n)."""
    effects: Array
    """Derivatives of sqrt(2 Q) (e_j - e_(j-1)), or ``by_model`` sqrt(2 Q) e_j, by q_j and by
    q_(j-1), (M, 2n, 3)."""
    curvature: Array
    """Second derivatives of the cost by q_j twice, by q_j and q_(j-1), by q_(j-1) and q_j, and by
    q_(j-1) twice, (M, 4, n, n)."""


def roll_out(problem: Tracking, angles: Array) -> Rollout:
    """Predict the tip for commanded angles, (M, n), and the cost."""
    constants, start_rad, offsets_mm, free_rad, extra_rad = problem
    by_model, chain = constants.by_model, constants.chain
    (steps, n), freedoms = angles.shape, chain.bending.shape[1]
    poses = np.empty((steps + 1, n))
    poses[0], poses[1:] = start_rad, angles
    bends = products(poses + extra_rad, chain.bending)
    moves, turns = poses[1:] - poses[:-1], (bends[1:] - bends[:-1]).reshape(steps, 1, freedoms)
    jet = jets(chain, bends[1:] if by_model else bends[:-1])
    if by_model:
        errors = offsets_mm + jet[:, 0]
    else:
        moved = products(turns, jet[:, 1 : freedoms + 1])
        errors = offsets_mm + accumulated(moved.reshape(steps, 3))
    residuals = constants.sizes * np.concatenate((errors, moves - free_rad), axis=1)
    return Rollout(angles, moves, turns, jet, errors, residuals, 0.5 * squared(residuals))


def expand(problem: Tracking, rollout: Rollout) -> Expansion:
    """Expand the cost at a rollout.

    With w_j = J(q_(j-1)) u_j, the errors follow from e_j = e_(j-1) + w_j. So the curvature of w_j
    counts as often as it enters an error: times the costate 2 Q (e_j + ... + e_M).
    """
    constants, residuals = problem.constants, rollout.residuals
    bending = constants.chain.bending
    (steps, _), (n, freedoms) = residuals.shape, bending.shape
    further = chosen(rollout.jets, constants.further).reshape(steps, freedoms, -1)
    derivatives = further.shape[2] // 3
    # The jets of the second order, and their derivatives along the moves.
    model = np.empty((steps, 2, derivatives, 3))
    model[:, 0] = rollout.jets[:, :derivatives]
    model[:, 1] = products(rollout.turns_rad, further).reshape(steps, derivatives, 3)
    costates = residuals[:, :3]
    if not constants.by_model:
        costates = accumulated(costates[::-1])[::-1]
    slopes = model.reshape(2 * steps, derivatives, 3)[:, 1 : freedoms + 1]
    effects = products(constants.effect, products(bending, slopes).reshape(steps, 2, 3 * n))
    costates = np.ascontiguousarray(costates).reshape(steps, 3, 1)
    pulled = products(model.reshape(steps, 2 * derivatives, 3), costates)
    square = products(pulled.reshape(steps, 2, derivatives), constants.square)
    curvature = products(constants.bend, square).reshape(steps, 4, n, n)
    return Expansion(constants, residuals, effects.reshape(steps, 2 * n, 3), curvature)


def accumulated(rows: Array) -> Array:
    """Sum of each row and all before it, (N, k)."""
    return np.add.accumulate(rows)


def squared(numbers: Array) -> float:
    """Sum of squares of any array."""
    flat = numbers.ravel()
    return float(np.dot(flat, flat))
