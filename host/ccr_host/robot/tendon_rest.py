"""Rest poses of any chain of segments on tendons: bending, tendons that only pull, and loads.

The bending vectors b of ``chain`` are B y with the degrees of freedom y: one of a planar segment,
two of a spatial one. In units of the bending stiffness k_1 of segment 1, the energy is

    sum_j rho_j |b_j|^2 / 2 + sum_i kappa_i max(0, x_i)^2 / 2 + load . (weighted sum of points),
    x_i = travel_i - slack_i - sum of r_i (n_i . b_j + e_j |b_j|^2) over the segments up to i's own

with n_i the direction of tendon i about the backbone. A tendon of a later segment is lengthened by
the bending of all earlier ones, too. e is the sag of a bent chain of disks, whose holes come closer
on both sides. For tendons that are all taut and no load, rest is the linear least-squares solution
with tendons and segments weighted by their stiffness; motion common to the tendons of a segment is
its null space, pretension.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.chain import Weights, point_mm

FloatArray = NDArray[np.float64]

_NEWTON_LIMIT = 40
_REST_RAD = 1e-8
_LONGEST_STEP_RAD = 0.5
_HALVINGS = 6
_LEAST_STIFFNESS = 0.05
"""Fraction of k_1 that keeps Newton's steps downhill if a load nearly buckles the robot."""
_PROBE_RAD = 1e-5


@dataclass(frozen=True, eq=False)
class TendonRobot:
    """What rest depends on, without a leading dimension.

    But ``slack_mm`` and ``tendon_stiffness_mm2`` may have one: robots that differ in these alone.
    """

    lengths_mm: FloatArray
    """(S,)."""
    freedom: FloatArray
    """B, (D, S, 2)."""
    stiffness: FloatArray
    """rho, (S,): of the segments, over that of the first."""
    lever_mm: FloatArray
    """r_i n_i for the segments that tendon i passes, zero for the others, (T, S, 2)."""
    sag_mm: FloatArray
    """r_i e_j for the segments that tendon i passes, zero for the others, (T, S)."""
    slack_mm: FloatArray
    """Travel that takes up the slack of each tendon of the straight robot, (T,)."""
    tendon_stiffness_mm2: FloatArray
    """kappa, (T,): stiffness of each tendon over k_1, per mm^2."""
    load_mm: FloatArray
    """Weight of everything over k_1, 1/mm, as the direction opposite to its pull, (3,)."""
    weights: Weights
    """Shares of that weight."""

    def bend_rad(self, y: FloatArray) -> FloatArray:
        """Bending vectors of degrees of freedom, (..., D) -> (..., S, 2)."""
        bend: FloatArray = np.tensordot(y, self.freedom, axes=1)
        return bend

    def stretch_mm(self, y: FloatArray, travel_mm: FloatArray) -> FloatArray:
        """x, (..., T), at degrees of freedom, (..., D), and tendon travel, (..., T)."""
        bend = self.bend_rad(y)
        route = np.tensordot(bend, self.lever_mm, axes=((-2, -1), (1, 2)))
        route += (bend**2).sum(axis=-1) @ self.sag_mm.T
        stretch: FloatArray = travel_mm - self.slack_mm - route
        return stretch

    def levers_mm(self, y: FloatArray) -> FloatArray:
        """Lengthening of each tendon's route by the degrees of freedom, mm/rad, (..., T, D)."""
        bend = self.bend_rad(y)
        lever = self.lever_mm + 2.0 * self.sag_mm[..., None] * bend[..., None, :, :]
        levers: FloatArray = np.tensordot(lever, self.freedom, axes=((-2, -1), (1, 2)))
        return levers

    def energy(self, y: FloatArray, travel_mm: FloatArray) -> FloatArray:
        """Energy over k_1, (...)."""
        bend = self.bend_rad(y)
        taut = np.maximum(self.stretch_mm(y, travel_mm), 0.0)
        height, _ = point_mm(self.lengths_mm, bend, self.weights)
        energy: FloatArray = (
            0.5 * (bend**2).sum(axis=-1) @ self.stiffness
            + 0.5 * taut**2 @ self.tendon_stiffness_mm2
            + height @ self.load_mm
        )
        return energy

    def moments(self, y: FloatArray, travel_mm: FloatArray) -> FloatArray:
        """Gradient of the energy, (..., D), zero at rest."""
        bend = self.bend_rad(y)
        pull = np.maximum(self.stretch_mm(y, travel_mm), 0.0) * self.tendon_stiffness_mm2
        by_bend = self.stiffness[:, None] * bend - np.tensordot(pull, self.lever_mm, axes=1)
        by_bend -= 2.0 * (pull @ self.sag_mm)[..., None] * bend
        by_bend += self._load_by(bend)
        moments: FloatArray = np.tensordot(by_bend, self.freedom, axes=((-2, -1), (1, 2)))
        return moments

    def stiffness_matrix(self, y: FloatArray, travel_mm: FloatArray) -> FloatArray:
        """Second derivatives of the energy, (..., D, D); those of the load by differences."""
        bend = self.bend_rad(y)
        stretch = self.stretch_mm(y, travel_mm)
        pull = np.maximum(stretch, 0.0) * self.tendon_stiffness_mm2
        by_y = self.levers_mm(y)
        taut = (stretch > 0.0) * self.tendon_stiffness_mm2
        matrix = np.einsum("...t,...td,...te->...de", taut, by_y, by_y)
        even = self.stiffness - 2.0 * pull @ self.sag_mm
        matrix += np.einsum("...s,dsi,esi->...de", even, self.freedom, self.freedom)
        if self.load_mm.any():
            near = bend[..., None, :, :] + _PROBE_RAD * self.freedom
            slope = (self._load_by(near) - self._load_by(bend)[..., None, :, :]) / _PROBE_RAD
            matrix += np.tensordot(slope, self.freedom, axes=((-2, -1), (1, 2)))
        stiffness: FloatArray = matrix
        return stiffness

    def rest(
        self,
        travel_mm: FloatArray,
        start: FloatArray | None = None,
        until_rad: float = _REST_RAD,
    ) -> FloatArray:
        """Degrees of freedom at rest, (N, D), by damped Newton steps from a guess.

        Args:
            travel_mm: pull of each tendon, (N, T).
            start: the guess, (N, D); by default the straight robot.
            until_rad: a step below this is the last one.
        """
        y = np.zeros((len(travel_mm), len(self.freedom))) if start is None else start.copy()
        moving = np.arange(len(y))
        for _ in range(_NEWTON_LIMIT):
            here, travel = y[moving], travel_mm[moving]
            gradient = self.moments(here, travel)
            step = -solved(self.stiffness_matrix(here, travel), gradient)
            step *= _LONGEST_STEP_RAD / np.maximum(
                np.abs(step).max(axis=1, keepdims=True), _LONGEST_STEP_RAD
            )
            y[moving] += step * self._share(here, travel, step, gradient)[:, None]
            moving = moving[np.abs(step).max(axis=1) > until_rad]
            if not len(moving):
                break
        return y

    def _share(
        self, y: FloatArray, travel_mm: FloatArray, step: FloatArray, gradient: FloatArray
    ) -> FloatArray:
        """Fraction of each step that leads downhill, (N,)."""
        energy = self.energy(y, travel_mm)
        promised = 1e-4 * np.einsum("nd,nd->n", gradient, step)
        share = np.ones(len(y))
        for _ in range(_HALVINGS):
            there = self.energy(y + share[:, None] * step, travel_mm)
            uphill = there > energy + share * promised + 1e-14 * np.abs(energy)
            if not uphill.any():
                break
            share[uphill] *= 0.5
        return share

    def _load_by(self, bend: FloatArray) -> FloatArray:
        if not self.load_mm.any():
            return np.zeros_like(bend)
        _, by = point_mm(self.lengths_mm, bend, self.weights)
        load_by: FloatArray = by @ self.load_mm
        return load_by


def pulled_mm(travel_mm: FloatArray, wound_mm: FloatArray, half_dead_mm: FloatArray) -> FloatArray:
    """Pull of tendons after further winding: the play operator.

    Args:
        travel_mm: pull of each before, (T,).
        wound_mm: what the motors have wound up since the tendons were put on, (T,).
        half_dead_mm: half of the travel that each loses after a reversal, (T,).
    """
    pulled: FloatArray = np.clip(travel_mm, wound_mm - half_dead_mm, wound_mm + half_dead_mm)
    return pulled


def solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """The solutions, (N, D), with the matrices, (N, D, D), made positive definite."""
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, _LEAST_STIFFNESS)
    along = np.einsum("nij,ni->nj", vectors, vector) / values
    solved: FloatArray = np.einsum("nij,nj->ni", vectors, along)
    return solved
