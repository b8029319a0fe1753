"""The optimisation problem of the MPC, (14)-(15): cost, gradient and exact Hessian.

Unknowns are the motor angles q_1..q_M to be commanded next rather than their increments
u_j = q_j - q_(j-1): the same problem by (13), but motor limits become plain bounds and each term
of (14) touches two neighbours only. Prediction errors are

    e_k = f_m - f_k + sum over j <= k of J(q_(j-1)) u_j,        k = 1..M,

and the cost is Q sum |e_k|^2 + R sum |u_j|^2. J is evaluated at the pose where its increment
begins, so the first one refers to the measured pose, as in (12); (13) and (14) print the same
index for the pose before and after a move. (15) counts N terms from k = 0; the one at k = 0
contains only the measurement, so M = N - 1 increments are free and the last is zero.

``by_model`` is the same problem with e_k = f_m - f_k + f(q_k) - f(q_0), for a controller whose f_m
is the model's tip plus a disturbance estimated against the model, which must not include the
linearisation error of (14)'s sums.

Positions are split as in ``two_motors``: f[0], and s = -f[1] + i f[2].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.mpc.two_motors import Geometry, TipJet, jet_at

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]
Block = tuple[float, float, float]
"""A symmetric 2 x 2 matrix: 11, 12, 22."""
_NOTHING = 0.0, 0.0, 0.0
Rows = Sequence[Sequence[float]] | FloatArray


class Weights(NamedTuple):
    """The weights Q (1/mm^2) and R (1/rad^2) of (15)."""

    position: float
    effort: float


class Tracking(NamedTuple):
    """An instance of the problem: where the robot is and where it should be."""

    geometry: Geometry
    weights: Weights
    start_rad: Pair
    """q_0, the last commanded angles."""
    start_jet: TipJet
    offsets_mm: list[tuple[float, complex]]
    """f_m - f_k for k = 1..M, the errors without any motion."""
    by_model: bool
    """Whether e_k is predicted by f(q_k) - f(q_0) instead of (14)'s sum."""


class Stage(NamedTuple):
    """The prediction of one step of the horizon."""

    jet: TipJet
    """The model at the pose where the move begins; with ``by_model``, where it ends."""
    move_rad: Pair
    error_across_mm: float
    error_sagittal_mm: complex


class Rollout(NamedTuple):
    """The prediction (14) for one choice of angles, and its cost (15)."""

    angles: list[Pair]
    stages: list[Stage]
    cost: float


class Expansion(NamedTuple):
    """The parts of the second-order expansion of the cost in the n = 2M flattened angles."""

    gradient: FloatArray
    """Gradient, (n,)."""
    lasting: FloatArray
    """(n, 4): effect of an angle on every error after its own; f[0], 0, s."""
    tail: FloatArray
    """(n, 4): its effect on the sum of its own and all later errors, times 2 Q."""
    blocks: list[tuple[Block, Block, Block]]
    """For each step: Gauss-Newton's block, the curvature in its angles, and the mixed curvature in
    its angles and those of the next step."""


def tracking(
    geometry: Geometry,
    weights: Weights,
    start_rad: Pair,
    position_mm: tuple[float, float, float],
    targets_mm: Rows,
) -> Tracking:
    """Set up the problem in the frame of (10); ``targets_mm`` has M rows of at least 3."""
    x, y, z = position_mm
    offsets_mm = [(x - target[0], complex(target[1] - y, z - target[2])) for target in targets_mm]
    start_jet = jet_at(geometry, start_rad[0], start_rad[1])
    return Tracking(geometry, weights, start_rad, start_jet, offsets_mm, by_model=False)


def roll_out(problem: Tracking, angles: list[Pair]) -> Rollout:
    """Predict the tip for M pairs of commanded angles, and the cost."""
    geometry, weights, (previous_1, previous_2), start_jet, offsets_mm, by_model = problem
    jet = start_jet
    moved_across, moved_sagittal = 0.0, 0j
    squared_error = squared_move = 0.0
    stages: list[Stage] = []
    for j in range(len(angles)):
        angle_1, angle_2 = angles[j]
        move_1, move_2 = angle_1 - previous_1, angle_2 - previous_2
        if by_model:
            jet = jet_at(geometry, angle_1, angle_2)
            moved_across = jet.across - start_jet.across
            moved_sagittal = jet.sagittal - start_jet.sagittal
        else:
            if j > 0:
                jet = jet_at(geometry, previous_1, previous_2)
            moved_across += jet.across_2 * move_2
            moved_sagittal += jet.sagittal_1 * move_1 + jet.sagittal_2 * move_2
        offset_across, offset_sagittal = offsets_mm[j]
        error_across = offset_across + moved_across
        error_sagittal = offset_sagittal + moved_sagittal
        squared_error += error_across * error_across
        squared_error += (error_sagittal * error_sagittal.conjugate()).real
        squared_move += move_1 * move_1 + move_2 * move_2
        stages.append(Stage(jet, (move_1, move_2), error_across, error_sagittal))
        previous_1, previous_2 = angle_1, angle_2
    cost = weights.position * squared_error + weights.effort * squared_move
    return Rollout(angles, stages, cost)


def expand(problem: Tracking, rollout: Rollout) -> Expansion:
    """Gradient and the parts of the Hessian of the cost at a rollout.

    With w_j = J(q_(j-1)) u_j, the angle q_j enters e_j through w_j alone (``own``, J itself) and
    every later error through w_j and w_(j+1) (``lasting``). The later errors affect it through the
    costate lambda = 2 Q (e_(j+1) + ... + e_M), which also multiplies the curvature of w_(j+1).
    """
    stages = rollout.stages
    steps = len(stages)
    twice_q, twice_r = 2.0 * problem.weights.position, 2.0 * problem.weights.effort
    gradient = np.empty(2 * steps)
    lasting, tail = np.zeros((2 * steps, 2), np.complex128), np.zeros((2 * steps, 2), np.complex128)
    blocks = [(_NOTHING, _NOTHING, _NOTHING)] * steps
    costate_across, costate_sagittal = 0.0, 0j
    across, sagittal_1, sagittal_2 = 0.0, 0j, 0j
    next_effort_1, next_effort_2 = 0.0, 0.0
    # Re(conj(a) b) is the inner product in the sagittal plane; costates are stored conjugated.
    for j in range(steps - 1, -1, -1):
        first, second, later = 2 * j, 2 * j + 1, steps - 1 - j
        jet, (move_1, move_2), error_across, error_sagittal = stages[j]
        own_across, own_1, own_2 = jet.across_2, jet.sagittal_1, jet.sagittal_2
        error_across = twice_q * error_across
        error_sagittal = twice_q * error_sagittal.conjugate()
        effort_1, effort_2 = twice_r * move_1, twice_r * move_2
        slope_1 = (error_sagittal * own_1).real + effort_1 - next_effort_1
        slope_2 = error_across * own_across + (error_sagittal * own_2).real
        slope_2 += effort_2 - next_effort_2
        next_effort_1, next_effort_2 = effort_1, effort_2
        twice, once = _NOTHING, _NOTHING
        if problem.by_model:
            twice = curvature_of_tip(error_across, error_sagittal, jet)
        elif later > 0:
            after, (move_1, move_2), _, _ = stages[j + 1]
            across = own_across - after.across_2 + after.across_22 * move_2
            by_12 = after.sagittal_12
            sagittal_1 = own_1 - after.sagittal_1 + after.sagittal_11 * move_1 + by_12 * move_2
            sagittal_2 = own_2 - after.sagittal_2 + by_12 * move_1 + after.sagittal_22 * move_2
            slope_1 += (costate_sagittal * sagittal_1).real
            slope_2 += costate_across * across + (costate_sagittal * sagittal_2).real
            lasting[first, 1] = sagittal_1
            lasting[second, 0], lasting[second, 1] = across, sagittal_2
            twice, once = curvature_of_move(
                costate_across, costate_sagittal, after, (move_1, move_2)
            )
        gradient[first], gradient[second] = slope_1, slope_2
        tail[first, 1] = twice_q * (own_1 + later * sagittal_1)
        tail[second, 0] = twice_q * (own_across + later * across)
        tail[second, 1] = twice_q * (own_2 + later * sagittal_2)
        left_1, right_1 = twice_q * own_1.conjugate(), twice_q * later * sagittal_1.conjugate()
        left_2, right_2 = own_2.conjugate() * own_2, sagittal_2.conjugate() * sagittal_2
        square_22 = own_across * own_across + later * across * across
        square = (
            (left_1 * own_1 + right_1 * sagittal_1).real,
            (left_1 * own_2 + right_1 * sagittal_2).real,
            twice_q * (square_22 + (left_2 + later * right_2).real),
        )
        blocks[j] = square, twice, once
        costate_across += error_across
        costate_sagittal += error_sagittal
    return Expansion(gradient, lasting.view(np.float64), tail.view(np.float64), blocks)


def curvature_of_move(
    costate_across: float, costate_sagittal: complex, jet: TipJet, move: Pair
) -> tuple[Block, Block]:
    """Second derivatives of costate * J(q) (q' - q): in q twice, and in q and q'."""
    move_1, move_2 = move
    bend_11, bend_12, bend_22 = curvature_of_tip(costate_across, costate_sagittal, jet)
    twist_11 = jet.sagittal_111 * move_1 + jet.sagittal_112 * move_2
    twist_12 = jet.sagittal_112 * move_1 + jet.sagittal_122 * move_2
    twist_22 = jet.sagittal_122 * move_1 + jet.sagittal_222 * move_2
    twice_11 = (costate_sagittal * twist_11).real - 2.0 * bend_11
    twice_12 = (costate_sagittal * twist_12).real - 2.0 * bend_12
    twice_22 = (costate_sagittal * twist_22).real - 2.0 * bend_22
    twice_22 += costate_across * jet.across_222 * move_2
    return (twice_11, twice_12, twice_22), (bend_11, bend_12, bend_22)


def curvature_of_tip(costate_across: float, costate_sagittal: complex, jet: TipJet) -> Block:
    """Second derivatives of costate * f(q)."""
    return (
        (costate_sagittal * jet.sagittal_11).real,
        (costate_sagittal * jet.sagittal_12).real,
        (costate_sagittal * jet.sagittal_22).real + costate_across * jet.across_22,
    )


def hessian(expansion: Expansion, effort_weight: float, blend: float, ridge: float) -> FloatArray:
    """Gauss-Newton's Hessian, positive semidefinite, plus ``blend`` times the curvature.

    (n, n), upper triangle only. The angles of a step i < j have the same effect on every
    error from that of step j on, so the block of both steps is lasting_i' tail_j. ``ridge``,
    relative to the trace of Gauss-Newton, is added to the diagonal.
    """
    matrix: FloatArray = expansion.lasting @ expansion.tail.T
    n = len(matrix)
    trace = 0.0
    effort = 2.0 * effort_weight
    last = n // 2 - 1
    for j in range(last + 1):
        first, second = 2 * j, 2 * j + 1
        square, (twice_11, twice_12, twice_22), (once_11, once_12, once_22) = expansion.blocks[j]
        square_11, square_12, square_22 = square
        efforts = effort
        if j < last:
            efforts += effort
            matrix[first, first + 2] += blend * once_11 - effort
            matrix[first, second + 2] += blend * once_12
            matrix[second, first + 2] += blend * once_12
            matrix[second, second + 2] += blend * once_22 - effort
        square_11, square_22 = square_11 + efforts, square_22 + efforts
        trace += square_11 + square_22
        matrix[first, first] = square_11 + blend * twice_11
        matrix[first, second] = square_12 + blend * twice_12
        matrix[second, second] = square_22 + blend * twice_22
    if ridge > 0.0:
        for i in range(n):
            matrix[i, i] += ridge * trace
    return matrix
