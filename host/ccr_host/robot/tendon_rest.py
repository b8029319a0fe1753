"""Rest poses of any chain of segments on tendons: bending, tendons that only pull, and loads.

The bending vectors b of ``chain`` are B y with the degrees of freedom y: one of a planar segment,
two of a spatial one. In units of the bending stiffness k_1 of segment 1, the energy is

    sum_j rho_j |b_j|^2 / 2 + sum_i kappa_i max(0, x_i)^2 / 2 + load . (weighted sum of points),
    x_i = travel_i - slack_i - sum of r_i (n_i . b_j + e_j |b_j|^2) over the segments up to i's own

with n_i the direction of tendon i about the backbone. A tendon of a later segment is lengthened by
the bending of all earlier ones, too. e is the sag of a bent chain of disks, whose holes come closer
on both sides, and whose backbone becomes shorter. Each column of B is a unit vector of one segment,
at right angles to the others, so |b_j|^2 is the sum of its y^2. For tendons that are all taut and
no load, rest is the linear least-squares solution with tendons and segments weighted by their
stiffness; motion common to the tendons of a segment is its null space, pretension.

Weight bends a segment most at its base. The halves of segment j bend by (b_j + u_j) / 2 and
(b_j - u_j) / 2, and u_j is where the energy, to first order, is least at the bending of rest: the
markers are seen where it puts them. What u_j changes in the moments is of second order in the
weight, and left out.

Dry friction F_i resists changes of a tendon's route s_i, the sum above. It is a spring of
``_STICKING_MM`` that lets go at F_i, between the route and an anchor that it drags along: in the
energy, F_i h(s_i - a_i) with h the Huber function. Anchors are given; without them nothing rubs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.robot.arc import LEAST_SOFTENED
from ccr_host.robot.chain import Weights, ends_mm, point_mm

_NEWTON_LIMIT = 40
_REST_RAD = 1e-8
_LONGEST_STEP_RAD = 0.5
_HALVINGS = 6
_LEAST_STIFFNESS = 0.05
"""Fraction of k_1 that keeps Newton's steps downhill if a load nearly buckles the robot."""
_PROBE_RAD = 1e-5
_STICKING_MM = 0.02
"""Yield of dry friction before a tendon slides: 0.3 deg of bending at a radius of 4.5 mm, as in the
model of the paper's robot."""
_STILL_STICKS_MM = _STICKING_MM * (1.0 - 1e-9)
"""A tendon that has just slid is at the limit and continues to slide in spite of rounding."""
_SWEEPS, _SAME_MM, _TURN_RAD = 8, 1e-5, 1e-4
"""Passes over rests that depend on the ones before, at most; a change of an anchor that counts, and
the last step of a pass."""


@dataclass(frozen=True, eq=False)
class TendonRobot:
    """What rest depends on; of several robots with leading axes, which broadcast with those of y.

    Only ``rest`` takes one robot alone.
    """

    lengths_mm: Array
    """(S,)."""
    freedom: Array
    """B, (D, S, 2)."""
    stiffness: Array
    """rho, (S,): of the segments, over that of the first."""
    lever_mm: Array
    """r_i n_i for the segments that tendon i passes, zero for the others, (T, S, 2)."""
    sag_mm: Array
    """r_i e_j for the segments that tendon i passes, zero for the others, (T, S)."""
    shorter_mm: Array
    """Shortening of each segment by a bending of 1 rad; it grows with the square, (S,)."""
    softening: Array
    """What the moment of segment k takes off the stiffness of segment j through tendons that sag
    there, in row k and column j, (S, S)."""
    slack_mm: Array
    """Travel that takes up the slack of each tendon of the straight robot, (T,)."""
    tendon_stiffness_mm2: Array
    """kappa, (T,): stiffness of each tendon over k_1, per mm^2."""
    friction_per_mm: Array
    """F over k_1: force at which each tendon begins to slide, (T,), or one for all, (1,)."""
    load_mm: Array
    """Weight of everything over k_1, 1/mm, as the direction opposite to its pull, (3,)."""
    weights: Weights
    """Shares of that weight."""

    @cached_property
    def _flat_freedom(self) -> Array:
        """(D, 2 S)."""
        return self.freedom.reshape(len(self.freedom), -1)

    @cached_property
    def _own(self) -> Array:
        """1 for the segment that each degree of freedom bends, (S, D)."""
        own: Array = (self.freedom**2).sum(axis=-1).T
        return own

    @cached_property
    def _straight_levers_mm(self) -> Array:
        """(..., T, D)."""
        flat = self.lever_mm.reshape(*self.lever_mm.shape[:-2], -1)
        return flat @ self._flat_freedom.T

    @cached_property
    def _own_sag_mm(self) -> Array:
        """(..., T, D)."""
        return self.sag_mm @ self._own

    @cached_property
    def _own_stiffness(self) -> Array:
        """(..., D)."""
        return self.stiffness @ self._own

    @cached_property
    def _half_lengths_mm(self) -> Array:
        return np.repeat(0.5 * self.lengths_mm, 2, axis=-1)

    @cached_property
    def _half_weights(self) -> Weights:
        at_end = np.repeat(self.weights.at_end, 2, axis=-1)
        at_end[..., ::2] = 0.0
        along = np.repeat(0.5 * self.weights.along, 2, axis=-1)
        return Weights(at_end, along, self.weights.tip_offset_mm)

    @cached_property
    def _half_shorter_mm(self) -> Array:
        return np.repeat(2.0 * self.shorter_mm, 2, axis=-1)

    @cached_property
    def _is_loaded(self) -> bool:
        return bool(self.load_mm.any())

    def bend_rad(self, y: Array) -> Array:
        """Bending vectors of degrees of freedom, (..., D) -> (..., S, 2)."""
        return (y @ self._flat_freedom).reshape(*y.shape[:-1], -1, 2)

    def ends_mm(self, y: Array) -> list[tuple[Array, Array]]:
        """``chain.ends_mm`` of the segments at rest, (..., D)."""
        return ends_mm(self._half_lengths_mm, self.halves_rad(y), self._half_shorter_mm)[1::2]

    def halves_rad(self, y: Array) -> Array:
        """Bending vectors of each half of the segments at rest, (..., D) -> (..., 2 S, 2)."""
        bend = self.bend_rad(y)
        halves: Array = np.repeat(0.5 * bend, 2, axis=-2)
        if not self._is_loaded:
            return halves
        _, by_half = point_mm(
            self._half_lengths_mm, halves, self._half_weights, self._half_shorter_mm
        )
        load_by = _times(by_half, self.load_mm[..., None, :])
        first, second = load_by[..., 0::2, :], load_by[..., 1::2, :]
        moments = self.stiffness[..., None] * bend + 0.5 * (first + second)
        sizes = np.sqrt((moments * moments).sum(axis=-1))
        softer = (sizes[..., None, :] @ self.softening)[..., 0, :]
        stiffness = np.maximum(self.stiffness - softer, LEAST_SOFTENED * self.stiffness)
        uneven = -0.5 * (first - second) / stiffness[..., None]
        along = uneven.reshape(*uneven.shape[:-2], -1) @ self._flat_freedom.T
        # Several robots at one y differ in the uneven part only.
        halves = np.broadcast_to(halves, load_by.shape).copy()
        halves[..., 0::2, :] += 0.5 * self.bend_rad(along)
        halves[..., 1::2, :] -= 0.5 * self.bend_rad(along)
        return halves

    @cached_property
    def rubs(self) -> bool:
        """Whether there is any dry friction."""
        return bool(self.friction_per_mm.any())

    def route_mm(self, y: Array) -> Array:
        """Travel that degrees of freedom, (..., D), take from each tendon, (..., T)."""
        return _times(self._straight_levers_mm, y) + _times(self._own_sag_mm, y * y)

    def stretch_mm(self, y: Array, travel_mm: Array) -> Array:
        """x, (..., T), at degrees of freedom, (..., D), and tendon travel, (..., T)."""
        stretch: Array = travel_mm - self.slack_mm - self.route_mm(y)
        return stretch

    def dragged_mm(self, y: Array, anchor_mm: Array) -> Array:
        """Anchors once tendons have slid to degrees of freedom, (..., D), both (..., T)."""
        route_mm = self.route_mm(y)
        return route_mm - _stuck_mm(route_mm - anchor_mm)

    def levers_mm(self, y: Array) -> Array:
        """Lengthening of each tendon's route by the degrees of freedom, mm/rad, (..., T, D)."""
        return self._straight_levers_mm + 2.0 * self._own_sag_mm * y[..., None, :]

    def sticking_mm2(self, away_mm: Array) -> Array:
        """Stiffness of tendons that stick, 1/mm^2, at routes beyond their anchors, (..., T)."""
        sticks = np.abs(away_mm) < _STILL_STICKS_MM
        return np.asarray(sticks * self.friction_per_mm / _STICKING_MM)

    def energy(
        self, y: Array, travel_mm: Array, anchor_mm: Array | None = None
    ) -> tuple[Array, Array]:
        """Energy over k_1, (...), and its gradient, the moments, (..., D), zero at rest.

        Args:
            y: degrees of freedom, (..., D).
            travel_mm: pull of each tendon, (..., T).
            anchor_mm: routes at which dry friction exerts no force, (..., T).
        """
        height, load_by = self._load(y)
        taut_mm = np.maximum(self.stretch_mm(y, travel_mm), 0.0)
        pull = self.tendon_stiffness_mm2 * taut_mm
        bent = self._own_stiffness * y
        energy = 0.5 * ((bent * y).sum(axis=-1) + (pull * taut_mm).sum(axis=-1)) + height
        if anchor_mm is not None and self.rubs:
            away_mm = self.route_mm(y) - anchor_mm
            stuck_mm = _stuck_mm(away_mm)
            held = self.friction_per_mm * stuck_mm / _STICKING_MM
            energy = energy + (held * (away_mm - 0.5 * stuck_mm)).sum(axis=-1)
            pull = pull - held
        return energy, bent + load_by - (pull[..., None, :] @ self.levers_mm(y))[..., 0, :]

    def moments(self, y: Array, travel_mm: Array, anchor_mm: Array | None = None) -> Array:
        """Gradient of the energy, (..., D), zero at rest."""
        return self.energy(y, travel_mm, anchor_mm)[1]

    def moments_by_travel(self, y: Array, travel_mm: Array) -> Array:
        """Derivatives of the moments by the travel of each tendon, (..., D, T)."""
        taut = (self.stretch_mm(y, travel_mm) > 0.0) * self.tendon_stiffness_mm2
        return -np.swapaxes(taut[..., None] * self.levers_mm(y), -1, -2)

    def stiffness_matrix(self, y: Array, travel_mm: Array, anchor_mm: Array | None = None) -> Array:
        """Second derivatives of the energy, (..., D, D); those of the load by differences."""
        pull = np.maximum(self.stretch_mm(y, travel_mm), 0.0) * self.tendon_stiffness_mm2
        by_route = -self.moments_by_travel(y, travel_mm)
        if anchor_mm is not None and self.rubs:
            away_mm = self.route_mm(y) - anchor_mm
            pull = pull - self.friction_per_mm * _stuck_mm(away_mm) / _STICKING_MM
            sticks_mm2 = self.sticking_mm2(away_mm)
            by_route = by_route + np.swapaxes(sticks_mm2[..., None] * self.levers_mm(y), -1, -2)
        even = self._own_stiffness - 2.0 * (pull[..., None, :] @ self._own_sag_mm)[..., 0, :]
        matrix = even[..., None] * np.eye(len(self.freedom))
        matrix += by_route @ self.levers_mm(y)
        if self._is_loaded:
            load_by = self._load(y[..., None, :] + steps_from_here(len(self.freedom), _PROBE_RAD))[
                1
            ]
            matrix += (load_by[..., 1:, :] - load_by[..., :1, :]) / _PROBE_RAD
        return matrix

    def compliance(self, y: Array, travel_mm: Array, anchor_mm: Array | None = None) -> Array:
        """Inverse of ``stiffness_matrix``, made positive definite, (..., D, D)."""
        values, vectors = np.linalg.eigh(self.stiffness_matrix(y, travel_mm, anchor_mm))
        soft = vectors / np.maximum(values, _LEAST_STIFFNESS)[..., None, :]
        compliance: Array = soft @ np.swapaxes(vectors, -1, -2)
        return compliance

    def rest(
        self,
        travel_mm: Array,
        start: Array | None = None,
        until_rad: float = _REST_RAD,
        anchor_mm: Array | None = None,
    ) -> Array:
        """Degrees of freedom at rest, (N, D), by damped Newton steps from a guess.

        Args:
            travel_mm: pull of each tendon, (N, T).
            start: the guess, (N, D); by default the straight robot.
            until_rad: a step below this is the last one.
            anchor_mm: routes at which dry friction exerts no force, (N, T).
        """
        y = np.zeros((len(travel_mm), len(self.freedom))) if start is None else start.copy()
        moving = np.arange(len(y))
        energy, moments = self.energy(y, travel_mm, anchor_mm)
        for _ in range(_NEWTON_LIMIT):
            here, travel = y[moving], travel_mm[moving]
            anchors = None if anchor_mm is None else anchor_mm[moving]
            step = -(self.compliance(here, travel, anchors) @ moments[..., None])[..., 0]
            size = np.abs(step).max(axis=1)
            step *= (_LONGEST_STEP_RAD / np.maximum(size, _LONGEST_STEP_RAD))[:, None]
            promised = 1e-4 * np.einsum("nd,nd->n", moments, step)
            allowed, share = energy + 1e-14 * np.abs(energy), np.ones(len(here))
            for _ in range(_HALVINGS + 1):
                there = here + share[:, None] * step
                energy, moments = self.energy(there, travel, anchors)
                uphill = energy > allowed + share * promised
                if not uphill.any():
                    break
                share[uphill] *= 0.5
            y[moving], goes_on = there, size > until_rad
            moving, energy, moments = moving[goes_on], energy[goes_on], moments[goes_on]
            if not len(moving):
                break
        return y

    def rests_in_turn(self, travel_mm: Array) -> tuple[Array, Array]:
        """Degrees of freedom at rests that follow each other, (N, D), and the anchors before each.

        All at once, with the anchors that the pass before has left, until they agree: where tendons
        slide on their way to every rest, the second pass does.

        Args:
            travel_mm: pull of each tendon, (N, T).
        """
        y = self.rest(travel_mm)
        anchors_mm, changed = self._anchors_mm(y), np.arange(len(y))
        for _ in range(_SWEEPS if self.rubs else 0):
            before_mm, near = anchors_mm, y[changed]
            y[changed] = self.rest(travel_mm[changed], near, _TURN_RAD, anchors_mm[changed])
            anchors_mm = self._anchors_mm(y)
            changed = np.flatnonzero(np.abs(anchors_mm - before_mm).max(axis=1) > _SAME_MM)
            if not len(changed):
                break
        return y, anchors_mm

    def _anchors_mm(self, y: Array) -> Array:
        """Those that tendons drag along over rows, (N, D), as they are before each, (N, T)."""
        anchor_mm, before = self.route_mm(y[0]), []
        for row in y:
            before.append(anchor_mm)
            anchor_mm = self.dragged_mm(row, anchor_mm)
        return np.array(before)

    def _load(self, y: Array) -> tuple[Array, Array]:
        """Its energy over k_1, (...), and the derivatives, (..., D)."""
        if not self._is_loaded:
            return np.zeros(y.shape[:-1]), np.zeros_like(y)
        bend = self.bend_rad(y)
        place_mm, by_bend = point_mm(self.lengths_mm, bend, self.weights, self.shorter_mm)
        load_by = _times(by_bend, self.load_mm[..., None, :])
        load_by = load_by.reshape(*load_by.shape[:-2], -1) @ self._flat_freedom.T
        return (place_mm * self.load_mm).sum(axis=-1), load_by


def steps_from_here(count: int, step: float) -> Array:
    """None, then one along each of some coordinates, (count + 1, count)."""
    return np.eye(count + 1, count, -1) * step


def _stuck_mm(away_mm: Array) -> Array:
    """Part of routes beyond anchors that friction resists as a spring."""
    return np.asarray(np.clip(away_mm, -_STICKING_MM, _STICKING_MM))


def _times(matrix: Array, vector: Array) -> Array:
    """Matrices times vectors, (..., m, n), (..., n) -> (..., m)."""
    return (matrix @ vector[..., None])[..., 0]


def pulled_mm(travel_mm: Array, wound_mm: Array, half_dead_mm: Array) -> Array:
    """Pull of tendons after further winding: the play operator.

    Args:
        travel_mm: pull of each before, (T,).
        wound_mm: what the motors have wound up since the tendons were put on, (T,).
        half_dead_mm: half of the travel that each loses after a reversal, (T,).
    """
    slack_side = np.maximum(travel_mm, wound_mm - half_dead_mm)
    return np.minimum(slack_side, wound_mm + half_dead_mm)
