"""Cost, gradient and Hessian of ``control.nlp`` on arrays that are set up once a step.

The Hessian needs no product of sensitivity matrices: with ``own`` and ``lasting`` of
``control.nlp``, its block of the steps i < j is 2 Q lasting_i' (own_j + (M - j) lasting_j), since
every error from j + 1 on sees the same of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control import nlp
from ccr_host.control.compiled.jit import callable_when_compiled, compiled
from ccr_host.control.compiled.model import Geometry, jet_at
from ccr_host.robot.kinematics import TipJet

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_priced_curvature = callable_when_compiled(nlp.priced_curvature)


class Tracking(NamedTuple):
    """``control.nlp.Tracking`` over M steps."""

    geometry: Geometry
    position_weight: float
    effort_weight: float
    start_rad: tuple[float, float]
    start_jet: TipJet
    offset_across_mm: FloatArray
    """(M,)."""
    offset_sagittal_mm: ComplexArray
    """(M,)."""


class Rollout(NamedTuple):
    """``control.nlp.Rollout`` without its cost; the arrays are written in place."""

    angles: FloatArray
    """(M, 2)."""
    moves: FloatArray
    """(M, 2)."""
    jets: list[TipJet]
    error_across_mm: FloatArray
    error_sagittal_mm: ComplexArray


class Expansion(NamedTuple):
    """Second-order expansion of the cost in the n = 2M flat angles, in parts."""

    gradient: FloatArray
    """(n,)."""
    lasting: FloatArray
    """(3, n): what an angle does to every error after its own."""
    tail: FloatArray
    """(3, n): what it does to its own and all later errors together, times 2 Q."""
    diagonal: FloatArray
    """(M, 2, 2): Gauss-Newton's blocks of one step."""
    curvature: FloatArray
    """(M, 2, 2): curvature by the angles of one step."""
    coupling: FloatArray
    """(M, 2, 2): curvature by the angles of a step and of the next."""


@compiled
def new_rollout(problem: Tracking) -> Rollout:
    """Room for one; its angles are to be filled in."""
    steps = len(problem.offset_across_mm)
    return Rollout(
        np.empty((steps, 2)),
        np.empty((steps, 2)),
        [problem.start_jet for _ in range(steps)],
        np.empty(steps),
        np.empty(steps, np.complex128),
    )


@compiled
def new_expansion(steps: int) -> Expansion:
    """Room for one."""
    return Expansion(
        np.empty(2 * steps),
        np.zeros((3, 2 * steps)),
        np.zeros((3, 2 * steps)),
        np.empty((steps, 2, 2)),
        np.zeros((steps, 2, 2)),
        np.zeros((steps, 2, 2)),
    )


@compiled
def roll_out(problem: Tracking, rollout: Rollout) -> float:
    """Fill in all but the angles; the cost (15)."""
    previous_1, previous_2 = problem.start_rad
    jet = problem.start_jet
    across, sagittal = 0.0, 0j
    squared_error = squared_move = 0.0
    for j in range(len(rollout.angles)):
        if j > 0:
            jet = jet_at(problem.geometry, previous_1, previous_2)
        angle_1, angle_2 = rollout.angles[j, 0], rollout.angles[j, 1]
        move_1, move_2 = angle_1 - previous_1, angle_2 - previous_2
        across += jet.across_2 * move_2
        sagittal += jet.sagittal_1 * move_1 + jet.sagittal_2 * move_2
        error_across = problem.offset_across_mm[j] + across
        error_sagittal = problem.offset_sagittal_mm[j] + sagittal
        squared_error += error_across * error_across
        squared_error += (error_sagittal * error_sagittal.conjugate()).real
        squared_move += move_1 * move_1 + move_2 * move_2
        rollout.moves[j, 0], rollout.moves[j, 1] = move_1, move_2
        rollout.jets[j] = jet
        rollout.error_across_mm[j] = error_across
        rollout.error_sagittal_mm[j] = error_sagittal
        previous_1, previous_2 = angle_1, angle_2
    return problem.position_weight * squared_error + problem.effort_weight * squared_move


@compiled
def expand(problem: Tracking, rollout: Rollout, expansion: Expansion) -> None:
    """Fill in the expansion at a rollout; see ``control.nlp.expand``."""
    steps = len(rollout.angles)
    twice_q, twice_r = 2.0 * problem.position_weight, 2.0 * problem.effort_weight
    own = np.zeros((3, 2))
    price_across, price_sagittal = 0.0, 0j
    for j in range(steps - 1, -1, -1):
        jet = rollout.jets[j]
        error_across = twice_q * rollout.error_across_mm[j]
        error_sagittal = twice_q * rollout.error_sagittal_mm[j].conjugate()
        own[1, 0], own[2, 0] = jet.sagittal_1.real, jet.sagittal_1.imag
        own[0, 1], own[1, 1], own[2, 1] = jet.across_2, jet.sagittal_2.real, jet.sagittal_2.imag
        slope_1 = (error_sagittal * jet.sagittal_1).real + twice_r * rollout.moves[j, 0]
        slope_2 = (
            error_across * jet.across_2
            + (error_sagittal * jet.sagittal_2).real
            + twice_r * rollout.moves[j, 1]
        )
        lasting = expansion.lasting[:, 2 * j : 2 * j + 2]
        if j + 1 < steps:
            after = rollout.jets[j + 1]
            move_1, move_2 = rollout.moves[j + 1, 0], rollout.moves[j + 1, 1]
            stays_across = jet.across_2 - after.across_2 + after.across_22 * move_2
            stays_1 = jet.sagittal_1 - after.sagittal_1
            stays_1 += after.sagittal_11 * move_1 + after.sagittal_12 * move_2
            stays_2 = jet.sagittal_2 - after.sagittal_2
            stays_2 += after.sagittal_12 * move_1 + after.sagittal_22 * move_2
            lasting[1, 0], lasting[2, 0] = stays_1.real, stays_1.imag
            lasting[0, 1], lasting[1, 1], lasting[2, 1] = stays_across, stays_2.real, stays_2.imag
            slope_1 += (price_sagittal * stays_1).real - twice_r * move_1
            slope_2 += (
                price_across * stays_across + (price_sagittal * stays_2).real - twice_r * move_2
            )
            curvature, coupling = _priced_curvature(
                price_across, price_sagittal, after, (move_1, move_2)
            )
            for row in range(2):
                for column in range(2):
                    expansion.curvature[j, row, column] = curvature[2 * row + column]
                    expansion.coupling[j, row, column] = coupling[2 * row + column]
        expansion.gradient[2 * j], expansion.gradient[2 * j + 1] = slope_1, slope_2
        _square_up(expansion, j, own, lasting, twice_q)
        price_across += error_across
        price_sagittal += error_sagittal


@compiled
def _square_up(
    expansion: Expansion, j: int, own: FloatArray, lasting: FloatArray, twice_q: float
) -> None:
    later = len(expansion.diagonal) - 1 - j
    for row in range(2):
        for column in range(2):
            square = 0.0
            for axis in range(3):
                square += own[axis, row] * own[axis, column]
                square += later * lasting[axis, row] * lasting[axis, column]
            expansion.diagonal[j, row, column] = twice_q * square
    for axis in range(3):
        for column in range(2):
            tail = twice_q * (own[axis, column] + later * lasting[axis, column])
            expansion.tail[axis, 2 * j + column] = tail


@compiled
def write_hessian(
    hessian: FloatArray, expansion: Expansion, effort_weight: float, blend: float, ridge: float
) -> None:
    """Upper triangle of Gauss-Newton's Hessian plus a share of the curvature.

    ``ridge``, relative to the trace, is added to the diagonal.
    """
    n = len(hessian)
    lasting, tail = expansion.lasting, expansion.tail
    for a in range(n):
        across, y, z = lasting[0, a], lasting[1, a], lasting[2, a]
        for b in range(a - a % 2 + 2, n):
            hessian[a, b] = across * tail[0, b] + y * tail[1, b] + z * tail[2, b]
    last = n // 2 - 1
    trace = 0.0
    for j in range(last + 1):
        effort = 2.0 * effort_weight * (1.0 if j == last else 2.0)
        for row in range(2):
            a = 2 * j + row
            for column in range(row, 2):
                hessian[a, 2 * j + column] = (
                    expansion.diagonal[j, row, column] + blend * expansion.curvature[j, row, column]
                )
            hessian[a, a] += effort
            trace += expansion.diagonal[j, row, row] + effort
            if j < last:
                for column in range(2):
                    hessian[a, a - row + 2 + column] += blend * expansion.coupling[j, row, column]
                hessian[a, a + 2] -= 2.0 * effort_weight
    for a in range(n):
        hessian[a, a] += ridge * trace
