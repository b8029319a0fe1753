"""The optimisation problem of the MPC, (14)-(15): cost, gradient and exact Hessian.

Unknowns are the motor angles q_1..q_M to be commanded next rather than their increments
u_j = q_j - q_(j-1): the same problem by (13), but motor limits become plain bounds and each term
of (14) touches two neighbours only. Prediction errors are

    e_k = f_m - f_k + sum over j <= k of J(q_(j-1)) u_j,        k = 1..M,

and the cost is Q sum |e_k|^2 + R sum |u_j|^2. J stands where its increment sets out, so that the
first one meets the pose that was measured, as (12) has it; (13) and (14) print the same index for
the pose before and after a move. (15) counts N terms from k = 0; the one at k = 0 holds only the
measurement, so M = N - 1 increments are live and the last is zero.

A whole step takes about a hundred microseconds, of which array overhead would be most; so what
belongs to one step of the horizon is done in plain numbers, with s = -f[1] + i f[2] as in
``robot.kinematics``, and only whole matrices are arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.kinematics import ConstantCurvature, TipJet

FloatArray = NDArray[np.float64]
Angles = list[tuple[float, float]]


@dataclass(frozen=True)
class Weights:
    """Q (1/mm^2) and R (1/rad^2) of (15)."""

    position: float
    effort: float


class Tracking(NamedTuple):
    """One instance: where the robot is and where it should be.

    ``start_rad`` is q_0, the angles commanded last. ``offset_across_mm`` and
    ``offset_sagittal_mm`` hold f_m - f_k for k = 1..M, the errors if nothing moved.
    """

    model: ConstantCurvature
    weights: Weights
    start_rad: tuple[float, float]
    start_jet: TipJet
    offset_across_mm: list[float]
    offset_sagittal_mm: list[complex]

    @classmethod
    def of(
        cls,
        model: ConstantCurvature,
        weights: Weights,
        start_rad: tuple[float, float],
        measured_mm: FloatArray,
        target_mm: FloatArray,
    ) -> Tracking:
        """From positions in the frame of (10): ``measured_mm`` (3,), ``target_mm`` (M, 3)."""
        x, y, z = measured_mm.tolist()
        targets = target_mm.tolist()
        return cls(
            model,
            weights,
            start_rad,
            model.jet_at(*start_rad),
            [x - target[0] for target in targets],
            [complex(target[1] - y, z - target[2]) for target in targets],
        )


class Rollout(NamedTuple):
    """The prediction (14) for one choice of angles, and its cost (15).

    ``jets[j]`` is the model at the pose from which ``moves[j]`` sets out.
    """

    angles: Angles
    moves: Angles
    jets: list[TipJet]
    error_across_mm: list[float]
    error_sagittal_mm: list[complex]
    cost: float


class Expansion(NamedTuple):
    """Second-order expansion of the cost in the flat angles (2M,).

    The exact Hessian is ``gauss_newton + curvature``; ``gauss_newton`` alone is positive
    semidefinite.
    """

    gradient: FloatArray
    gauss_newton: FloatArray
    curvature: FloatArray


def roll_out(problem: Tracking, angles: Angles) -> Rollout:
    """Predict and price the consequences of M commanded angles."""
    jet = problem.start_jet
    previous_1, previous_2 = problem.start_rad
    moved_across, moved_sagittal = 0.0, 0j
    squared_error = squared_move = 0.0
    moves: Angles = []
    jets: list[TipJet] = []
    across: list[float] = []
    sagittal: list[complex] = []
    for (angle_1, angle_2), offset_across, offset_sagittal in zip(
        angles, problem.offset_across_mm, problem.offset_sagittal_mm, strict=True
    ):
        if jets:
            jet = problem.model.jet_at(previous_1, previous_2)
        move_1, move_2 = angle_1 - previous_1, angle_2 - previous_2
        moved_across += jet.across_2 * move_2
        moved_sagittal += jet.sagittal_1 * move_1 + jet.sagittal_2 * move_2
        error_across = offset_across + moved_across
        error_sagittal = offset_sagittal + moved_sagittal
        squared_error += (
            error_across * error_across + (error_sagittal * error_sagittal.conjugate()).real
        )
        squared_move += move_1 * move_1 + move_2 * move_2
        jets.append(jet)
        moves.append((move_1, move_2))
        across.append(error_across)
        sagittal.append(error_sagittal)
        previous_1, previous_2 = angle_1, angle_2
    cost = problem.weights.position * squared_error + problem.weights.effort * squared_move
    return Rollout(angles, moves, jets, across, sagittal, cost)


def expand(problem: Tracking, rollout: Rollout) -> Expansion:
    """Gradient and both parts of the Hessian of the cost at a rollout.

    With w_j = J(q_(j-1)) u_j, the angle q_j enters e_j through w_j alone (``own``) and every
    later error through w_j and w_(j+1) (``lasting``); what the later errors weigh is their
    price, lambda = 2 Q (e_(j+1) + ... + e_M). It also prices the curvature of w_(j+1).
    """
    jets, moves = rollout.jets, rollout.moves
    steps = len(jets)
    twice_q = 2.0 * problem.weights.position
    twice_r = 2.0 * problem.weights.effort
    own_x, own_y, own_z = _zeros(steps), _zeros(steps), _zeros(steps)
    lasting_x, lasting_y, lasting_z = _zeros(steps), _zeros(steps), _zeros(steps)
    gradient = _zeros(steps)
    blocks: list[float] = []
    couplings: list[float] = []
    price_across, price_sagittal = 0.0, 0j
    # Re(conj(a) b) is the inner product in the sagittal plane; prices are kept conjugated.
    for j in range(steps - 1, -1, -1):
        first, second = 2 * j, 2 * j + 1
        jet = jets[j]
        error_across = twice_q * rollout.error_across_mm[j]
        error_sagittal = twice_q * rollout.error_sagittal_mm[j].conjugate()
        own_x[second] = jet.across_2
        own_y[first], own_z[first] = jet.sagittal_1.real, jet.sagittal_1.imag
        own_y[second], own_z[second] = jet.sagittal_2.real, jet.sagittal_2.imag
        slope_1 = (error_sagittal * jet.sagittal_1).real + twice_r * moves[j][0]
        slope_2 = (
            error_across * jet.across_2
            + (error_sagittal * jet.sagittal_2).real
            + twice_r * moves[j][1]
        )
        if j + 1 < steps:
            after = jets[j + 1]
            move_1, move_2 = moves[j + 1]
            stays_across = jet.across_2 - after.across_2 + after.across_22 * move_2
            stays_1 = jet.sagittal_1 - after.sagittal_1
            stays_1 += after.sagittal_11 * move_1 + after.sagittal_12 * move_2
            stays_2 = jet.sagittal_2 - after.sagittal_2
            stays_2 += after.sagittal_12 * move_1 + after.sagittal_22 * move_2
            lasting_x[second] = stays_across
            lasting_y[first], lasting_z[first] = stays_1.real, stays_1.imag
            lasting_y[second], lasting_z[second] = stays_2.real, stays_2.imag
            slope_1 += (price_sagittal * stays_1).real - twice_r * move_1
            slope_2 += (
                price_across * stays_across + (price_sagittal * stays_2).real - twice_r * move_2
            )
            block, coupling = priced_curvature(price_across, price_sagittal, after, moves[j + 1])
            blocks += block
            couplings += coupling
        gradient[first], gradient[second] = slope_1, slope_2
        price_across += error_across
        price_sagittal += error_sagittal

    layout = _layout(steps)
    parts = np.array([own_x, own_y, own_z, lasting_x, lasting_y, lasting_z])
    sensitivity = layout.at * parts[:3] + layout.after * parts[3:]
    sensitivity = sensitivity.reshape(3 * steps, 2 * steps)
    curvature = np.zeros((2 * steps, 2 * steps))
    curvature[layout.curved_rows, layout.curved_columns] = blocks + couplings + couplings
    return Expansion(
        np.array(gradient),
        twice_q * (sensitivity.T @ sensitivity) + twice_r * layout.effort,
        curvature,
    )


Block = tuple[float, float, float, float]


def priced_curvature(
    price_across: float, price_sagittal: complex, jet: TipJet, move: tuple[float, float]
) -> tuple[Block, Block]:
    """Second derivatives of price * J(q) (q' - q), rows first: by q twice, by q and q'."""
    move_1, move_2 = move
    bend_11 = (price_sagittal * jet.sagittal_11).real
    bend_12 = (price_sagittal * jet.sagittal_12).real
    bend_22 = (price_sagittal * jet.sagittal_22).real + price_across * jet.across_22
    twist_11 = jet.sagittal_111 * move_1 + jet.sagittal_112 * move_2
    twist_12 = jet.sagittal_112 * move_1 + jet.sagittal_122 * move_2
    twist_22 = jet.sagittal_122 * move_1 + jet.sagittal_222 * move_2
    twice_11 = (price_sagittal * twist_11).real - 2.0 * bend_11
    twice_12 = (price_sagittal * twist_12).real - 2.0 * bend_12
    twice_22 = (price_sagittal * twist_22).real - 2.0 * bend_22
    twice_22 += price_across * jet.across_222 * move_2
    return (twice_11, twice_12, twice_12, twice_22), (bend_11, bend_12, bend_12, bend_22)


def _zeros(steps: int) -> list[float]:
    return [0.0] * (2 * steps)


@dataclass(frozen=True)
class _Layout:
    """Where things go in matrices over a horizon of M steps; depends on M alone."""

    at: FloatArray
    """(M, 1, 2M): 1 where the error's step k is the angle's step j."""
    after: FloatArray
    """(M, 1, 2M): 1 where k > j."""
    effort: FloatArray
    """(2M, 2M): half the Hessian of the squared moves."""
    curved_rows: NDArray[np.intp]
    """Of the curvature: diagonal blocks from the last, blocks above them, blocks below."""
    curved_columns: NDArray[np.intp]


@lru_cache(maxsize=128)
def _layout(steps: int) -> _Layout:
    of_error = np.arange(steps)[:, None, None]
    of_angle = np.repeat(np.arange(steps), 2)
    differences = np.eye(2 * steps) - np.eye(2 * steps, k=-2)
    block_starts = 2 * np.arange(steps - 2, -1, -1)[:, None]
    rows = (block_starts + np.array([0, 0, 1, 1])).ravel()
    columns = (block_starts + np.array([0, 1, 0, 1])).ravel()
    return _Layout(
        at=(of_error == of_angle).astype(np.float64),
        after=(of_error > of_angle).astype(np.float64),
        effort=differences.T @ differences,
        curved_rows=np.concatenate([rows, rows, columns + 2]),
        curved_columns=np.concatenate([columns, columns + 2, rows]),
    )
