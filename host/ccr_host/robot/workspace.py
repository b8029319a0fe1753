"""What a robot can reach, and the configuration nearest to any point.

A path is given in two lateral coordinates, f[0] and f[2] of (10), or in all three. Many
configurations may be equally near; among these the effort of `projection` decides. The nearest one
is found by following it from the straightest pose while its target moves in a straight line to the
middle of the cell in which the point lies, once for all points of a cell, and then to the point: a
minimum, not always the least one. It is a function of the point alone, so a closed path is closed
in motor angles too, however finely it is sampled. It may jump between neighbouring points from one
minimum to another.

Robots with more degrees of freedom than a path has coordinates follow the path by those
configurations that take least effort together with their changes, as fast changes that keep the tip
where it is would disturb it. Of others, a path that meets a jump follows each of its minima to both
ends, and changes between them where they are close.

Of the paper's robot it is the sheet of the workspace around the straight pose, up to its folds: a
segment bent beyond its fold rolls up further and reaches less far to the side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.core.arrays import Array, IntArray
from ccr_host.description.schema import Servo
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.projection import EFFORTS, Projection
from ccr_host.robot.reference import is_closed

LATERAL = [0, 2]
"""The coordinates of f that a path gives."""

_DIGITS = 12
"""Motor angles are rounded to these decimals of a radian, so that motors which stay where they are
do so exactly."""

_STAGES = 16
"""Parts of the way of a target; a step of one can be followed by Newton's steps."""
_STAGE_STEPS, _STAGE_RAD = 6, 1e-2
_CELL = 1 / 32
"""Size of a cell over the robot's length: half a stage of a target one length away. A path of 1600
points passes some hundred cells."""
_LAST_STEPS, _LAST_RAD = 100, 1e-12
_FARTHEST = 1e4
"""Targets are brought to this many lengths; nearest configurations are no longer different."""
_ROWS = 4096
"""Points that are computed at a time."""
_RIM_STEPS, _RIM_RAD = 12, 1e-8
_JUMP_RAD = 0.2
"""Bending by which a point's configuration differs from its neighbour's, and from what continues
that."""
_FARTHER = 1e-5
"""Distance over the robot's length by which points may be missed for the sake of even changes."""
_FOLLOWED, _FOLLOWING_STEPS, _FOLLOWING_RAD = 1e-8, 8, 1e-5
"""Weight over the square of the robot's length by which a configuration stays near the last one."""
_APPROACHED = 1e-4, 1e-6
"""Likewise, one after the other, where the last one is some hundredths of a millimetre away."""
_RETURN_LENGTHS = 0.2
"""Way of the tip, in lengths of the robot, over which configurations return to the least effort."""
_LONGEST_PART = 0.01
"""Way of the tip, likewise, between the knots of a path."""
_MOST_BRANCHES = 8
_STEP_PRICE_MM2_RAD2 = 1.0
"""A jump of a radian between two followed points costs as much as a millimetre at one of them."""
_OUTSIDE = 1e-6
"""Distance over the robot's length from which a point is out of reach."""


@dataclass(frozen=True)
class MotorLimits:
    """Interval of all motor angles, (n,) each, rad."""

    lower_rad: Array
    upper_rad: Array

    @classmethod
    def of(cls, servo: Servo) -> MotorLimits:
        """The limits that the board enforces."""
        return cls(np.radians(servo.angle_min_deg), np.radians(servo.angle_max_deg))

    def clip(self, q_rad: ArrayLike) -> Array:
        """Motor angles clipped to the limits, rad; shape of ``q_rad``."""
        return np.minimum(np.maximum(q_rad, self.lower_rad), self.upper_rad)

    def without_pretension(self, model: ConstantCurvature, q_rad: Array) -> Array:
        """The poses nearest to some, (K, n), that bend a robot alike without any pretension.

        If one of ``three-spatial``'s motors turned by 30 deg alone, the three tendons of its
        segment would pull with 14 to 19 N each, under which the backbone buckles. Poses out of the
        limits bend it less; a motor that cannot pay out stays at its limit.
        """
        by_motors = model.bending_rad(np.eye(model.motors))
        if np.linalg.matrix_rank(by_motors) == model.motors:
            return q_rad
        found_rad = (q_rad @ by_motors @ np.linalg.pinv(by_motors)).round(_DIGITS)
        reach_rad = np.where(found_rad < 0.0, self.lower_rad, self.upper_rad)
        beyond = np.divide(found_rad, reach_rad, np.zeros_like(reach_rad), where=reach_rad != 0.0)
        return self.clip(found_rad / np.maximum(beyond.max(axis=1, keepdims=True), 1.0))


@dataclass(frozen=True)
class Nearest:
    """Nearest reachable configurations: ``q_rad`` (N, n), ``tip_mm`` (N, 3), ``distance_mm`` (N,).

    The distance is that of the tip in the coordinates that were given.
    """

    q_rad: Array
    tip_mm: Array
    distance_mm: Array


def axes_of(points_mm: Array) -> list[int]:
    """The coordinates of f that points of two or three columns state."""
    return LATERAL if points_mm.shape[1] == len(LATERAL) else [0, 1, 2]


class Surface(Protocol):
    """What a robot reaches according to some model of it."""

    @property
    def length_mm(self) -> float:
        """Described length of its segments, to which paths in space are scaled."""
        ...

    def nearest(self, points_mm: ArrayLike) -> Nearest:
        """Project points onto the surface.

        Args:
            points_mm: desired f[0] and f[2], (N, 2), or desired f, (N, 3); any finite numbers.
        """
        ...

    def along(self, points_mm: ArrayLike) -> Nearest:
        """Project the points of a path onto the surface, see ``nearest``."""
        ...


class Workspace:
    """What one robot of constant curvature (10) reaches between its motor limits."""

    def __init__(self, model: ConstantCurvature, limits: MotorLimits) -> None:
        self.model = model
        self.limits = limits
        self.length_mm: float = sum(model.lengths_mm)
        self._straightest_rad = limits.clip(np.zeros(model.motors))
        self._projection = Projection(model, limits.lower_rad, limits.upper_rad)
        self._length_mm = self._projection.length_mm
        self.effort = self._projection.effort

    def nearest(self, points_mm: ArrayLike) -> Nearest:
        """Project points onto the workspace.

        Args:
            points_mm: desired f[0] and f[2], (N, 2), or desired f, (N, 3); any finite numbers.

        Returns:
            The configuration of least distance for each point, in the coordinates given, and that
            distance.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        axes = axes_of(points)
        pieces = [
            self._approached(points[first : first + _ROWS], axes)
            for first in range(0, len(points), _ROWS)
        ]
        q_rad = np.concatenate(pieces) if pieces else np.empty((0, self.model.motors))
        tip_mm = self.model.tip_mm(q_rad)
        # Points near the largest float overflow to infinite distance, which is acceptable.
        with np.errstate(over="ignore"):
            miss = np.linalg.norm(tip_mm[:, axes] - points, axis=1)
        return Nearest(q_rad, tip_mm, miss)

    def along(self, points_mm: ArrayLike) -> Nearest:
        """Project the points of a path; configurations change evenly along it, see the module.

        Args:
            points_mm: see ``nearest``; two or more, in the order of the path.
        """
        found, points = self.nearest(points_mm), np.asarray(points_mm, dtype=np.float64)
        axes = axes_of(points)
        has_choice = len(self.model.segment_of_freedom) > len(axes)
        if not has_choice and not len(self._jumps(found.q_rad, points, axes)):
            return found
        is_loop = has_choice and is_closed(points)
        rows = np.append(np.arange(len(points)), np.zeros(int(is_loop), dtype=int))
        way_mm = np.linalg.norm(np.diff(points[rows], axis=0), axis=1).cumsum()
        way_mm = np.insert(way_mm, 0, 0.0)
        parts = math.ceil(min(way_mm[-1] / (_LONGEST_PART * self._length_mm), _ROWS))
        knots_mm = np.linspace(0.0, way_mm[-1], parts + 1)
        line = _between(knots_mm, way_mm, points[rows])
        if not has_choice:
            at_knots = self._chosen_branch(line, axes)
        elif parts > 1:
            at_knots = _between(knots_mm, way_mm, found.q_rad[rows])
            at_knots = self._projection.evened(at_knots, line, axes, is_closed=is_loop)
        else:
            return found
        q = _between(way_mm[: len(points)], knots_mm, at_knots)
        for weight in (*_APPROACHED, _FOLLOWED):
            q = self._continued(q, points, points, axes, weight)
        tip_mm = self.model.tip_mm(q)
        miss_mm = np.linalg.norm(tip_mm[:, axes] - points, axis=1)
        is_farther = (miss_mm - found.distance_mm).max() > _FARTHER * self._length_mm
        if is_farther or self._bends_rad(q).max() > self._bends_rad(found.q_rad).max():
            return found
        return Nearest(q, tip_mm, miss_mm)

    def _chosen_branch(self, line_mm: Array, axes: list[int]) -> Array:
        """The cheapest configurations along a line of those on its branches, (N, n)."""
        branches = self._branches(line_mm, axes)
        miss_mm = np.linalg.norm(self.model.tip_mm(branches)[..., axes] - line_mm[:, None], axis=-1)
        from_middle = branches - self._projection.middle_rad
        effort = EFFORTS[0] * ((from_middle @ self.effort) * from_middle).sum(axis=-1)
        bending = self.model.bending_rad(branches)
        chosen = cheapest(bending, miss_mm**2 + effort, _STEP_PRICE_MM2_RAD2)
        best: Array = branches[np.arange(len(line_mm)), chosen]
        return best

    def _branches(self, line_mm: Array, axes: list[int]) -> Array:
        """The nearest configurations between two jumps, followed to both ends, (N, K, n)."""
        q = self.nearest(line_mm).q_rad
        ends = np.concatenate([[0], self._jumps(q, line_mm, axes), [len(q)]])
        longest = np.argsort(ends[:-1] - ends[1:], kind="stable")[:_MOST_BRANCHES]
        middles = (ends[longest] + ends[longest + 1]) // 2
        branches = np.repeat(q[:, None], len(middles), axis=1)
        first, last = int(middles.min()), int(middles.max())
        for step, rows in ((1, range(first + 1, len(q))), (-1, range(last - 1, -1, -1))):
            for row in rows:
                later = np.flatnonzero((row - middles) * step > 0)
                was, now = (np.tile(line_mm[i], (len(later), 1)) for i in (row - step, row))
                branches[row, later] = self._continued(branches[row - step, later], was, now, axes)
        return branches

    def _jumps(self, q_rad: Array, points_mm: Array, axes: list[int]) -> IntArray:
        """Points whose configuration is far from the one before, and does not continue it."""
        far = np.flatnonzero(self._bends_rad(q_rad) > _JUMP_RAD)
        ahead_rad = self._continued(q_rad[far], points_mm[far], points_mm[far + 1], axes)
        apart_rad = np.abs(self.model.bending_rad(ahead_rad - q_rad[far + 1])).max(axis=1)
        jumps: IntArray = far[apart_rad > _JUMP_RAD] + 1
        return jumps

    def _bends_rad(self, q_rad: Array) -> Array:
        """Largest change of a bending from each of N configurations to the next, (N - 1,)."""
        bends: Array = np.abs(self.model.bending_rad(np.diff(q_rad, axis=0))).max(axis=1)
        return bends

    def _continued(
        self,
        q_rad: Array,
        from_mm: Array,
        to_mm: Array,
        axes: list[int],
        weight: float = _FOLLOWED,
    ) -> Array:
        """Configurations of points that are near those of other points, (N, n)."""
        way_mm = np.linalg.norm(to_mm - from_mm, axis=1, keepdims=True)
        share = np.minimum(1.0, way_mm / (_RETURN_LENGTHS * self._length_mm))
        middle_rad = q_rad + share * (self._projection.middle_rad - q_rad)
        steps, until_rad = _FOLLOWING_STEPS, _FOLLOWING_RAD
        return self._projection.descended(q_rad, to_mm, axes, weight, steps, until_rad, middle_rad)

    def boundary_mm(self, points: int = 240) -> Array:
        """The edge of what is reached laterally as a closed line, (points + 1, 3)."""
        angle = np.linspace(0.0, 2.0 * np.pi, points + 1)
        away = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        start_mm = self.model.tip_mm(self._straightest_rad)[LATERAL]
        q = np.repeat(self._straightest_rad[None], points + 1, axis=0)
        reached_mm, stride_mm = np.zeros(points + 1), np.full(points + 1, self._length_mm / 16.0)
        while np.any(walking := stride_mm > _OUTSIDE * self._length_mm):
            rows = np.flatnonzero(walking)
            target_mm = start_mm + (reached_mm + stride_mm)[rows, None] * away[rows]
            there = self._projection.descended(
                q[rows], target_mm, LATERAL, EFFORTS[-1], _RIM_STEPS, _RIM_RAD
            )
            miss_mm = np.linalg.norm(self.model.tip_mm(there)[:, LATERAL] - target_mm, axis=1)
            is_reached = miss_mm <= _OUTSIDE * self._length_mm
            q[rows[is_reached]] = there[is_reached]
            reached_mm[rows[is_reached]] += stride_mm[rows[is_reached]]
            stride_mm[rows[~is_reached]] *= 0.5
        return self.model.tip_mm(q)

    def _approached(self, points_mm: Array, axes: list[int]) -> Array:
        start_mm = self.model.tip_mm(self._straightest_rad)[axes]
        with np.errstate(over="ignore", invalid="ignore"):
            away_mm = points_mm - start_mm
            size_mm = np.abs(away_mm).max(axis=1, keepdims=True)
            share = np.minimum(1.0, _FARTHEST * self._length_mm / np.maximum(size_mm, 1e-300))
        away_mm = np.where(np.isfinite(away_mm), away_mm, 0.0) * share
        cell_mm = _CELL * self._length_mm
        cells, cell_of = np.unique(np.round(away_mm / cell_mm), axis=0, return_inverse=True)
        q = np.repeat(self._straightest_rad[None], len(cells), axis=0)
        for stage in range(1, _STAGES):
            target_mm = start_mm + stage / _STAGES * cell_mm * cells
            q = self._projection.descended(q, target_mm, axes, EFFORTS[0], _STAGE_STEPS, _STAGE_RAD)
        q = q[cell_of]
        for effort in EFFORTS:
            until_rad = _LAST_RAD if effort == EFFORTS[-1] else _STAGE_RAD * effort
            q = self._projection.descended(
                q, start_mm + away_mm, axes, effort, _LAST_STEPS, until_rad
            )
        return q


def cheapest(bending_rad: Array, cost: Array, price: float) -> Array:
    """One candidate of each sample: least sum of costs and of the price of squared steps.

    Args:
        bending_rad: of K candidates of each of N samples, (N, K, D).
        cost: of each, (N, K); infinite if it is none.
        price: of a step's square, by all of D.

    Returns:
        The chosen candidate of each sample, (N,), by Viterbi's algorithm.
    """
    sums, came_from = cost[0], []
    for before, here, price_here in zip(bending_rad[:-1], bending_rad[1:], cost[1:], strict=True):
        steps = ((here[:, None] - before[None]) ** 2).sum(axis=-1)
        totals = sums[None] + price * steps
        best = totals.argmin(axis=1)
        came_from.append(best)
        sums = price_here + totals[np.arange(len(best)), best]
    chosen = [int(sums.argmin())]
    for best in reversed(came_from):
        chosen.append(int(best[chosen[-1]]))
    return np.array(chosen[::-1])


def _between(at: Array, knots: Array, rows: Array) -> Array:
    """Rows, (N, n), between those at knots."""
    return np.stack([np.interp(at, knots, column) for column in rows.T], axis=1)
