"""Priors for labelling: where the markers of a tendon-driven robot can be and how they can move.

Two models share one interface. `ChainModel` needs the camera's rotation and models the whole robot;
`FreeModel` needs no rotation and models distances only. Both treat motor motion only as a hint that
something moves, because slack and gravity determine how far the tip moves.

The robot has S segments, hence S + 1 markers, and D degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Robot
from ccr_host.robot.kinematics import ConstantCurvature, bending_of_motors
from ccr_host.tracking.markers.shapes import (
    Distances,
    Shapes,
    Steps,
    Tolerances,
    levers_mm,
    within,
)

Array = NDArray[np.float64]

FRAME_S = 0.05
"""Process noise is stated for the 20 Hz of a Polaris and scaled to other intervals."""
_CALMING = 0.7
"""Decay of the agitation per frame: ringing a few frames ago still widens the gates."""
_MOTOR_SHARE = 0.5
"""Standard deviation of the motion caused by a motor, as a fraction of (4), (5)."""
_LIMIT = 3.5
"""Standard deviations beyond which a pose cannot be this robot's."""


@dataclass(frozen=True, eq=False)
class Belief:
    """State of a motion model."""

    mean: Array
    """(n,)."""
    covariance: Array
    """(n, n)."""
    agitation: Array
    """Decaying maximum of recent deviations from the expected pose; shape and units of the model's
    own."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expected positions of all markers but M1, relative to M1: 3 S coordinates."""

    mean_mm: Array
    """(3 S,): M2, M3, and so on."""
    covariance_mm2: Array
    """(3 S, 3 S), excluding the camera's noise."""
    jacobian: Array
    """(3 S, n): derivative of the expectation with respect to the state."""


def rows_of(marker: int) -> slice:
    """Coordinates of a marker in an expectation; M2 is number 1."""
    return slice(3 * marker - 3, 3 * marker)


def expectation(belief: Belief, mean_mm: Array, jacobian: Array) -> Expectation:
    """Propagate the covariance of the state to the markers."""
    return Expectation(mean_mm, jacobian @ belief.covariance @ jacobian.T, jacobian)


def corrected(
    belief: Belief, expected: Expectation, rows: NDArray[np.intp], seen_mm: Array, noise_mm: float
) -> tuple[Array, Array]:
    """Kalman update with some of the coordinates; returns the new mean and covariance.

    ``rows`` are the indices of the measured coordinates, ``noise_mm`` is the camera's noise per
    coordinate.
    """
    jacobian = expected.jacobian[rows]
    innovation_covariance = expected.covariance_mm2[np.ix_(rows, rows)] + noise_mm**2 * np.eye(
        len(rows)
    )
    gain = np.linalg.solve(innovation_covariance, jacobian @ belief.covariance).T
    mean = belief.mean + gain @ (seen_mm - expected.mean_mm[rows])
    covariance = belief.covariance - gain @ innovation_covariance @ gain.T
    return mean, 0.5 * (covariance + covariance.T)


class Seed(NamedTuple):
    """A pose derived from points of one frame."""

    view: int
    """Number of the base from which the points are seen."""
    points: tuple[int, ...]
    """Indices of the points of M2, M3, and so on."""
    belief: Belief
    log_density: float
    """Logarithm of the prior density of these points, in 1/mm^(3 S)."""


class MotionModel(Protocol):
    """Prior of all markers but M1, relative to M1."""

    def seeds(self, points_mm: Array, taken: list[int], q_rad: Array) -> Iterator[Seed]:
        """Poses that put the markers at points of a frame, without any history.

        Args:
            points_mm: (B, N, 3), the frame's points relative to each of B possible bases.
            taken: the point that each base is, or -1.
            q_rad: believed motor angles, (n,).
        """

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        """The belief after `duration_s`, during which the motors were commanded to move, (n,)."""

    def expect(self, belief: Belief) -> Expectation:
        """Expected marker positions of a belief."""

    def expected_mm(self, belief: Belief) -> Array:
        """Their mean alone, (3 S,)."""

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        """The belief with a corrected mean and covariance; updates the agitation."""

    def holds(self, belief: Belief) -> bool:
        """Whether the pose is possible at all, regardless of its history."""


class ChainModel:
    """Constant curvature with free degrees of freedom and slowly varying offsets.

    State: the degrees of freedom; of each marker its offset from its modelled position relative to
    the marker before it. It discriminates well because, whatever the tendons do, each marker moves
    on a curve or a surface relative to the one before it: points have to satisfy one or two
    constraints each, and each marker gives information on the others.
    Vectors are in the robot's frame.
    """

    _FLOOR_RAD = 0.003, 0.006
    """Of all segments but the last, whose end shows its bending less, and of the last."""
    _OFFSET_WALK_MM = 0.12, 0.06
    _OFFSET_PER_RAD = 2.5, 2.0
    """Change of the offsets with the bending angles, mm/rad."""
    _START_RAD = 0.03
    _START_OFFSET_MM = 0.5, 0.3
    _NOISE_RAD = 0.004, 0.006
    """Size of the corrections caused by the camera's noise alone."""
    _SWEEP_RAD = 2.57
    """The markers sweep this times their lever along each degree of freedom."""

    def __init__(self, geometry: Robot) -> None:
        self._model = model = ConstantCurvature(geometry)
        tolerances = Tolerances.of(geometry)
        self._deviation_mm = tolerances.deviation_mm
        self._shapes = Shapes(geometry, Steps(self._deviation_mm), _LIMIT)
        self._segment = segment = model.segment_of_freedom
        self._freedoms, self._segments = len(segment), len(self._deviation_mm)
        self._by_motors = np.abs(bending_of_motors(geometry))
        self._by_offsets = np.kron(np.tri(self._segments), np.eye(3))
        """The offset of a marker moves all later ones as well."""
        is_last = np.arange(self._segments) == self._segments - 1
        self._walk_mm, self._per_rad, self._start_mm = (
            np.where(is_last, pair[1], pair[0])
            for pair in (self._OFFSET_WALK_MM, self._OFFSET_PER_RAD, self._START_OFFSET_MM)
        )
        self._floor_rad, self._noise_rad = (
            np.where(is_last[segment], pair[1], pair[0])
            for pair in (self._FLOOR_RAD, self._NOISE_RAD)
        )
        constrained = 3 * self._segments - self._freedoms
        tip_levers_mm = levers_mm(geometry)[-1]
        self._log_room = 0.5 * constrained * math.log(2.0 * math.pi)
        self._log_room += float(np.log(self._SWEEP_RAD * tip_levers_mm).sum())
        # A segment leaves two constraints if it is planar, one if it is spatial.
        left = 3 - np.bincount(segment)
        self._log_room += float(left @ np.log(self._deviation_mm))

    def seeds(self, points_mm: Array, taken: list[int], q_rad: Array) -> Iterator[Seed]:
        for found in self._shapes.among(points_mm, taken, self._model.bending_rad(q_rad)):
            offsets = self._offsets(found.seen_mm, found.bending_rad)
            mean = np.concatenate([found.bending_rad, offsets.ravel()])
            deviation = [self._START_RAD] * self._freedoms, np.repeat(self._start_mm, 3)
            covariance = np.diag(np.concatenate(deviation) ** 2)
            agitation = np.full(self._freedoms, self._START_RAD)
            belief = Belief(mean, covariance, agitation)
            yield Seed(found.view, found.points, belief, -0.5 * found.cost - self._log_room)

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        frames = duration_s / FRAME_S
        stir = _MOTOR_SHARE * self._by_motors @ np.abs(motor_motion_rad)
        turn = np.hypot(np.hypot(self._floor_rad, belief.agitation), stir) * math.sqrt(frames)
        of_segment = np.sqrt(np.bincount(self._segment, turn**2))
        walk = np.hypot(self._walk_mm * math.sqrt(frames), self._per_rad * of_segment)
        covariance = belief.covariance.copy()
        covariance[np.diag_indices(len(covariance))] += (
            np.concatenate([turn, np.repeat(walk, 3)]) ** 2
        )
        return Belief(belief.mean, covariance, belief.agitation * _CALMING**frames)

    def expect(self, belief: Belief) -> Expectation:
        places, slopes = self._model.markers_mm(belief.mean[None, : self._freedoms])
        by_bending = slopes[0].reshape(len(self._by_offsets), -1)
        mean = places[0].ravel() + self._by_offsets @ belief.mean[self._freedoms :]
        return expectation(belief, mean, np.hstack([by_bending, self._by_offsets]))

    def expected_mm(self, belief: Belief) -> Array:
        places, _ = self._model.markers_mm(belief.mean[None, : self._freedoms])
        mean_mm: Array = places[0].ravel() + self._by_offsets @ belief.mean[self._freedoms :]
        return mean_mm

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        change = np.abs(mean - before.mean)[: self._freedoms]
        surprise = np.maximum(change - self._noise_rad, 0.0)
        return Belief(mean, covariance, np.maximum(before.agitation, surprise))

    def holds(self, belief: Belief) -> bool:
        offsets = belief.mean[self._freedoms :].reshape(-1, 3)
        return bool(np.all(np.linalg.norm(offsets, axis=1) < _LIMIT * self._deviation_mm))

    def _offsets(self, seen_mm: Array, bending_rad: Array) -> Array:
        places, _ = self._model.markers_mm(bending_rad[None])
        offsets: Array = np.diff(seen_mm - places[0], axis=0, prepend=0.0)
        return offsets


class FreeModel:
    """Points with velocities, initialised where all distances fit a pose of the robot.

    State: positions of all markers but M1, and their displacement per frame. It needs no rotation
    because distances do not depend on one.
    """

    _FLOOR_MM = 0.1, 0.15
    """Of M2 and of the tip; between them in equal steps."""
    _START_MM = 1.5
    _NOISE_MM = 0.2
    """Size of the corrections caused by the camera's noise alone."""
    _PUSH = 0.5
    """Change of the displacement per frame, as a fraction of the change of position."""
    _SHELL_MM2 = 4.0 * math.pi * 50.0**2
    """Area on which M2 can lie about M1 when nothing is known about the camera's rotation."""
    _RING_MM = 2.0 * math.pi * 30.0
    """Length of the ring on which M3 can then lie at given distances."""
    _RANGE_MM = 32.0
    """Range of a distance over one degree of freedom."""

    def __init__(self, geometry: Robot) -> None:
        self._model = ConstantCurvature(geometry)
        self._by_motors = np.abs(bending_of_motors(geometry))
        self._levers_mm = levers_mm(geometry)
        self._bounds_mm = Tolerances.of(geometry).bounds_mm
        distances = Distances(Tolerances.of(geometry).deviation_mm)
        self._shapes = Shapes(geometry, distances, _LIMIT)
        self._segments, freedoms = self._levers_mm.shape
        self._floor_mm = np.linspace(*self._FLOOR_MM, self._segments)
        room_mm = self._SHELL_MM2 * (self._RING_MM if self._segments > 1 else 1.0)
        turns = min(3 * self._segments - 1, 3)
        ranges = min(freedoms, 3 * self._segments - turns)
        constrained = 3 * self._segments - turns - ranges
        surface_mm = distances.surface_mm * math.sqrt(2.0 * math.pi)
        self._log_room = math.log(room_mm) + ranges * math.log(self._RANGE_MM)
        self._log_room += constrained * math.log(surface_mm)

    def seeds(self, points_mm: Array, taken: list[int], q_rad: Array) -> Iterator[Seed]:
        for found in self._shapes.among(points_mm, taken, self._model.bending_rad(q_rad)):
            size = found.seen_mm.size
            mean = np.concatenate([found.seen_mm.ravel(), np.zeros(size)])
            covariance = np.diag([0.3**2] * size + [self._START_MM**2] * size)
            belief = Belief(mean, covariance, np.full(self._segments, self._START_MM))
            yield Seed(found.view, found.points, belief, -0.5 * found.cost - self._log_room)

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        frames, size = duration_s / FRAME_S, 3 * self._segments
        stir = _MOTOR_SHARE * self._levers_mm @ self._by_motors @ np.abs(motor_motion_rad)
        kick = np.hypot(np.hypot(self._floor_mm, belief.agitation), stir)
        step = np.eye(2 * size)
        step[:size, size:] = frames * np.eye(size)
        covariance = step @ belief.covariance @ step.T
        variance = np.repeat(kick, 3) ** 2
        covariance[np.diag_indices(2 * size)] += frames * np.concatenate(
            [variance, self._PUSH**2 * variance]
        )
        return Belief(step @ belief.mean, covariance, belief.agitation * _CALMING**frames)

    def expect(self, belief: Belief) -> Expectation:
        size = 3 * self._segments
        return expectation(belief, belief.mean[:size], np.eye(size, 2 * size))

    def expected_mm(self, belief: Belief) -> Array:
        return belief.mean[: 3 * self._segments]

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        change = (mean - before.mean)[: 3 * self._segments].reshape(-1, 3)
        surprise = np.linalg.norm(change, axis=1) / math.sqrt(3.0) - self._NOISE_MM
        return Belief(mean, covariance, np.maximum(before.agitation, surprise))

    def holds(self, belief: Belief) -> bool:
        places = belief.mean[: 3 * self._segments].reshape(-1, 3)
        apart_mm = np.linalg.norm(np.diff(places, axis=0, prepend=0.0), axis=1)
        return bool(within(apart_mm, self._bounds_mm).all())
