"""Which points of a frame can be the markers of a robot, by its shape alone.

Points are taken for M1, M2 and so on, one marker after the other. Each time, the degrees of freedom
of the segments so far are fitted to the points, and only points that some pose explains are kept:
of many points very few chains are left after two segments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccr_host.core.arrays import Array, BoolArray, IntArray
from ccr_host.description.schema import Robot
from ccr_host.robot.chain import PAPER_FRAME, bend_of
from ccr_host.robot.kinematics import ConstantCurvature, freedom_of

_BELIEVED_BENDING_SIGMA_RAD = 0.7
"""Slack, sag and servo lag between believed and true bending; 0.3 to 0.5 were seen on the twin."""
_DEVIATION_MM, _DEVIATION_SHARE = (2.5, 1.0), (0.042, 0.022)
"""Deviation of a marker from constant curvature, relative to the marker before it: sag, rotation
error, glue, at least, and as a share of a long segment. First of all segments whose bending shows
in where the next one points, then of the last."""
_MARGIN = 4.0, 2.0
"""Deviations by which a distance may be beyond the geometry's."""
SURFACE_MM = 3.0
"""Deviation of the distance between markers that are not neighbours."""
LIMIT = 3.5
"""Standard deviations beyond which a pose cannot be this robot's."""
_SPHERE_MM = 11.5
"""Two of NDI's passive spheres cannot be closer to each other."""
_STARTS_RAD = 0.0, 0.7, 1.4, 2.1, 2.8
_DIRECTIONS = 8
_STEPS = 12
_DONE_RAD = 3e-3
_IMAGINARY = 1e-20
"""Step along the imaginary axis that gives derivatives to rounding (Squire and Trapp, Using complex
variables to estimate derivatives of real functions, SIAM Review 40, 1998)."""
_DAMPING_FIRST, _DAMPING_FALL, _DAMPING_RISE = 1e-3, 0.1, 10.0
_MOST = 1500
"""Chains of points that are kept at a time, the best ones."""


class Tolerances(NamedTuple):
    """How far a robot may be from its description, mm."""

    deviation_mm: Array
    """(S,): standard deviation of each marker relative to the one before it."""
    bounds_mm: Array
    """(S, 2): bounds of the distance between the two, for every pose and camera."""

    @classmethod
    def of(cls, geometry: Robot) -> Tolerances:
        """Tolerances of a robot: glue, noise and sag."""
        lengths_mm = np.array([segment.length_mm for segment in geometry.chain])
        is_last = np.arange(len(lengths_mm)) == len(lengths_mm) - 1
        least_mm, share, margin = (
            np.where(is_last, of_last, of_others)
            for of_others, of_last in (_DEVIATION_MM, _DEVIATION_SHARE, _MARGIN)
        )
        deviation_mm = np.maximum(least_mm, share * lengths_mm)
        # A chord is never longer than its arc, and turns the offset by half a turn at most.
        swing_mm = 2.0 * _swung_offset_mm(geometry).max(axis=0)
        most_mm = np.hypot(lengths_mm, swing_mm) + margin * deviation_mm
        return cls(deviation_mm, np.stack([np.full_like(most_mm, _SPHERE_MM), most_mm], axis=1))


def levers_mm(geometry: Robot) -> Array:
    """Largest motion of each marker with each degree of freedom, mm/rad, (S, D)."""
    ends_mm = np.cumsum([segment.length_mm for segment in geometry.chain])
    swung_mm = _swung_offset_mm(geometry)
    number = ConstantCurvature(geometry).segment_of_freedom
    starts_mm = np.concatenate([[0.0], ends_mm])[number]
    levers = ends_mm[:, None] - starts_mm + swung_mm.max(axis=1)
    return np.where(np.arange(len(ends_mm))[:, None] >= number, levers, 0.0)


def _swung_offset_mm(geometry: Robot) -> Array:
    """Part of the markers' offset that a degree of freedom turns, per segment, (D, S)."""
    return geometry.marker_offset_mm * np.abs(freedom_of(geometry.chain)[..., 1])


def within(values: Array, bounds: Array) -> BoolArray:
    """Whether values are in an interval, (..., 2), its ends included."""
    return np.asarray((values >= bounds[..., 0]) & (values <= bounds[..., 1]))


Misfit = Callable[[Array, Array, Array], Array]
"""How much K markers are elsewhere than a pose says, in standard deviations: vectors of misfits,
(..., M, V), of their places, of those seen, (..., K, 3) each relative to M1, and of
``Tolerances.deviation_mm``."""


def steps(places_mm: Array, seen_mm: Array, deviation_mm: Array) -> Array:
    """Misfit of the vectors from each marker to the next, in the robot's frame, (..., K, 3)."""
    apart_mm = np.diff(places_mm - seen_mm, axis=-2, prepend=0.0)
    return apart_mm / deviation_mm[: apart_mm.shape[-2], None]


def distances(places_mm: Array, seen_mm: Array, deviation_mm: Array) -> Array:
    """Misfit of the distances between all markers, which no turn of the camera changes."""
    first, second = np.triu_indices(places_mm.shape[-2] + 1, k=1)
    deviation_mm = np.where(second == first + 1, deviation_mm[second - 1], SURFACE_MM)
    places, seen = (
        np.concatenate([np.zeros_like(one[..., :1, :]), one], axis=-2)
        for one in (places_mm, seen_mm)
    )
    # Not numpy's norm, whose complex one is real.
    expected_mm, seen_apart_mm = (
        np.sqrt(((one[..., second, :] - one[..., first, :]) ** 2).sum(axis=-1))
        for one in (places, seen)
    )
    misfits: Array = ((expected_mm - seen_apart_mm) / deviation_mm)[..., None]
    return misfits


@dataclass(frozen=True, eq=False)
class Found:
    """Points that can be the markers."""

    view: int
    """Number of the base from which they are seen."""
    points: tuple[int, ...]
    """Their indices, of M2 first."""
    seen_mm: Array
    """(S, 3): where they are, relative to M1."""
    bending_rad: Array
    """(D,): the pose that explains them best."""
    cost: float
    """Sum of the squares of all misfits, and of the bending beyond the believed one."""


class Shapes:
    """Looks for the robot among points, where a pose leaves no misfit of more than ``LIMIT``."""

    def __init__(self, geometry: Robot, misfit: Misfit) -> None:
        self._model = ConstantCurvature(geometry)
        self._misfit = misfit
        self.tolerances = Tolerances.of(geometry)
        self._freedom = freedom_of(geometry.chain)
        offset_mm = np.array([0.0, geometry.marker_offset_mm, 0.0])
        self._starts: list[tuple[Array, Array]] = []
        """Degrees of freedom of each segment, (G, d), and its marker seen from its base, (G, 3),
        relative to where the marker would be there."""
        for number, segment in enumerate(geometry.chain):
            free = _starts_rad(segment.bends == "space")
            own = self._freedom[self._model.segment_of_freedom == number, number]
            bend = bend_of(free @ own)
            ends_mm = segment.length_mm * bend.end + bend.turn @ offset_mm - offset_mm
            self._starts.append((free, ends_mm))

    def among(self, points_mm: Array, taken: list[int], q_rad: Array) -> Iterator[Found]:
        """All chains of points that the robot can explain, without any history.

        Args:
            points_mm: (B, N, 3): the points, seen from each of B bases.
            taken: the point that is the base itself, or -1, of each base.
            q_rad: believed motor angles, (n,).
        """
        believed_rad = self._model.bending_rad(q_rad)
        view: IntArray = np.arange(len(points_mm))
        chosen: IntArray = np.array(taken, dtype=np.intp)[:, None]
        bending_rad: Array = np.zeros((len(view), 0))
        cost: Array = np.zeros(len(view))
        for number, bounds_mm in enumerate(self.tolerances.bounds_mm):
            row, point = self._next(points_mm[view], chosen, number, bounds_mm)
            if not len(row):
                return
            view, chosen = view[row], np.column_stack([chosen[row], point])
            seen_mm = points_mm[view[:, None], chosen[:, 1:]]
            bending_rad = self._started(seen_mm, bending_rad[row], number, believed_rad)
            bending_rad, worst, cost = self._fitted(seen_mm, bending_rad, believed_rad)
            kept = np.flatnonzero(worst <= LIMIT)
            kept = kept[np.argsort(cost[kept], kind="stable")[:_MOST]]
            view, chosen = view[kept], chosen[kept]
            bending_rad, cost = bending_rad[kept], cost[kept]
        for index, labels in enumerate(chosen[:, 1:]):
            seen = points_mm[view[index], labels]
            points = tuple(labels.tolist())
            yield Found(int(view[index]), points, seen, bending_rad[index], float(cost[index]))

    def _next(
        self, points_mm: Array, chosen: IntArray, number: int, bounds_mm: Array
    ) -> tuple[IntArray, IntArray]:
        """Rows of chains, and points that are as far from their last marker as a segment allows."""
        rows = np.arange(len(chosen))
        last = points_mm[rows, chosen[:, -1]][:, None] if number else 0.0
        fits = within(np.linalg.norm(points_mm - last, axis=2), bounds_mm)
        for column in chosen.T:
            fits[rows[column >= 0], column[column >= 0]] = False
        row, point = np.nonzero(fits)
        return row, point

    def _started(
        self, seen_mm: Array, before_rad: Array, number: int, believed_rad: Array
    ) -> Array:
        """A first guess of the bending of one more segment, (N, D')."""
        free, ends_mm = self._starts[number]
        own = before_rad.shape[1]
        frame = np.broadcast_to(PAPER_FRAME, (len(seen_mm), 3, 3))
        for bend in np.moveaxis(np.tensordot(before_rad, self._freedom[:own, :number], 1), 1, 0):
            frame = frame @ bend_of(bend).turn
        before_mm = self._model.markers_mm(before_rad)[0] if number else seen_mm[:, :0]
        places_mm = np.repeat(before_mm[:, None], len(free), axis=1)
        last_mm = before_mm[:, None, -1] if number else 0.0
        ends = last_mm + ends_mm @ np.swapaxes(frame, 1, 2)
        places_mm = np.concatenate([places_mm, ends[:, :, None]], axis=2)
        misfits = self._misfit(places_mm, seen_mm[:, None], self.tolerances.deviation_mm)
        beyond = (free - believed_rad[own : own + free.shape[1]]) / _BELIEVED_BENDING_SIGMA_RAD
        best = np.argmin((misfits**2).sum(axis=(2, 3)) + (beyond**2).sum(axis=1), axis=1)
        return np.concatenate([before_rad, free[best]], axis=1)

    def _fitted(
        self, seen_mm: Array, start_rad: Array, believed_rad: Array
    ) -> tuple[Array, Array, Array]:
        """Least squares by Levenberg and Marquardt's method.

        Returns:
            Degrees of freedom, (N, D'), the largest misfits, (N,), and costs, (N,).
        """
        bending_rad, freedoms = start_rad, start_rad.shape[1]
        believed_rad = believed_rad[:freedoms]
        misfits, slopes = self._look(seen_mm, bending_rad, believed_rad)
        damping = np.full(len(bending_rad), _DAMPING_FIRST)
        for _ in range(_STEPS):
            square = np.swapaxes(slopes, 1, 2) @ slopes
            square += damping[:, None, None] * square * np.eye(freedoms)
            gradient = np.swapaxes(slopes, 1, 2) @ misfits[:, :, None]
            step_rad = np.linalg.solve(square, gradient)[:, :, 0]
            if np.abs(step_rad).max() < _DONE_RAD:
                break
            trial_rad = bending_rad - step_rad
            trial, trial_slopes = self._look(seen_mm, trial_rad, believed_rad)
            better = (trial**2).sum(axis=1) < (misfits**2).sum(axis=1)
            bending_rad = np.where(better[:, None], trial_rad, bending_rad)
            misfits = np.where(better[:, None], trial, misfits)
            slopes = np.where(better[:, None, None], trial_slopes, slopes)
            damping = damping * np.where(better, _DAMPING_FALL, _DAMPING_RISE)
        of_shape = self._misfit(
            self._model.markers_mm(bending_rad)[0], seen_mm, self.tolerances.deviation_mm
        )
        worst = np.linalg.norm(of_shape, axis=2).max(axis=1)
        worst = np.maximum(worst, np.abs(misfits[:, -freedoms:]).max(axis=1))
        return bending_rad, worst, (misfits**2).sum(axis=1)

    def _look(self, seen_mm: Array, bending_rad: Array, believed_rad: Array) -> tuple[Array, Array]:
        """Misfits of the points and of the bending, (N, M), and their derivatives, (N, M, D')."""
        poses, freedoms = bending_rad.shape
        places_mm, slopes_mm = self._model.markers_mm(bending_rad)
        moved_mm = places_mm + 1j * _IMAGINARY * np.moveaxis(slopes_mm, 3, 0)
        of_shape = self._misfit(moved_mm, seen_mm, self.tolerances.deviation_mm)
        of_shape = np.moveaxis(of_shape.reshape(freedoms, poses, -1), 0, 2)
        beyond = (bending_rad - believed_rad) / _BELIEVED_BENDING_SIGMA_RAD
        by_beyond = np.tile(np.eye(freedoms) / _BELIEVED_BENDING_SIGMA_RAD, (poses, 1, 1))
        misfits = np.concatenate([of_shape[..., 0].real, beyond], axis=1)
        return misfits, np.concatenate([of_shape.imag / _IMAGINARY, by_beyond], axis=1)


def _starts_rad(is_spatial: bool) -> Array:
    """Degrees of freedom of a segment from which its fit may start, (G, 1) or (G, 2)."""
    if not is_spatial:
        return np.array([sign * start for start in _STARTS_RAD for sign in (1.0, -1.0)])[1:, None]
    angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.zeros((1, 2)), *[start * ring for start in _STARTS_RAD[1:]]])
