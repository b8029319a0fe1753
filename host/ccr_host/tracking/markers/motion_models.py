"""Priors for labelling: where the markers of a tendon-driven robot can be and how they can move.

Two models share one interface. `ChainModel` needs the camera's rotation and models the whole robot;
`FreeModel` needs no rotation and models distances only. Both treat motor motion only as a hint that
something moves, because slack and gravity determine how far the tip moves.

The robot has S segments, hence S + 1 markers, and D degrees of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.description.schema import Robot
from ccr_host.robot.kinematics import ConstantCurvature, bending_of_motors
from ccr_host.tracking.markers.shapes import (
    LIMIT,
    SURFACE_MM,
    Found,
    Shapes,
    distances,
    levers_mm,
    steps,
    within,
)

FRAME_S = 0.05
"""Process noise is stated for the 20 Hz of a Polaris and scaled to other intervals."""
_CALMING = 0.7
"""Decay of the agitation per frame: ringing a few frames ago still widens the gates."""
_MOTOR_SHARE = 0.5
"""Standard deviation of the motion caused by a motor, as a fraction of (4), (5)."""


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


class MotionModel(Protocol):
    """Prior of all markers but M1, relative to M1."""

    shapes: Shapes
    """Where to look for poses that put the markers at points of a frame, without any history."""
    log_room: float
    """Minus the logarithm of the prior density of such points where they fit best, in
    1/mm^(3 S)."""

    def started(self, found: Found) -> Belief:
        """The belief in such a pose."""

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        """The belief after `duration_s`, during which the motors were commanded to move, (n,)."""

    def expect(self, belief: Belief) -> tuple[Array, Array]:
        """Expected marker positions, (S, 3), and derivatives by the state, (S, 3, n)."""

    def surprise(self, correction: Array) -> Array:
        """Agitation that a correction of the mean, (n,), shows beyond that by the noise."""

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
    """Floors of all segments but the last, and of the last, whose end shows its bending less."""
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
        self.shapes = Shapes(geometry, steps)
        self._deviation_mm = self.shapes.tolerances.deviation_mm
        self._segment = segment = model.segment_of_freedom
        self._freedoms, self._segments = len(segment), len(self._deviation_mm)
        self._by_motors = np.abs(bending_of_motors(geometry))
        by_offsets = np.kron(np.tri(self._segments), np.eye(3))
        self._by_offsets = by_offsets.reshape(self._segments, 3, -1)
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
        self.log_room = 0.5 * constrained * math.log(2.0 * math.pi)
        self.log_room += float(np.log(self._SWEEP_RAD * tip_levers_mm).sum())
        # A segment leaves two constraints if it is planar, one if it is spatial.
        left = 3 - np.bincount(segment)
        self.log_room += float(left @ np.log(self._deviation_mm))

    def started(self, found: Found) -> Belief:
        places, _ = self._model.markers_mm(found.bending_rad[None])
        offsets = np.diff(found.seen_mm - places[0], axis=0, prepend=0.0)
        mean = np.concatenate([found.bending_rad, offsets.ravel()])
        deviation = [self._START_RAD] * self._freedoms, np.repeat(self._start_mm, 3)
        covariance = np.diag(np.concatenate(deviation) ** 2)
        return Belief(mean, covariance, np.full(self._freedoms, self._START_RAD))

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

    def expect(self, belief: Belief) -> tuple[Array, Array]:
        places, slopes = self._model.markers_mm(belief.mean[None, : self._freedoms])
        mean_mm = places[0] + self._by_offsets @ belief.mean[self._freedoms :]
        return mean_mm, np.concatenate([slopes[0], self._by_offsets], axis=2)

    def surprise(self, correction: Array) -> Array:
        return np.abs(correction[: self._freedoms]) - self._noise_rad

    def holds(self, belief: Belief) -> bool:
        offsets = belief.mean[self._freedoms :].reshape(-1, 3)
        return bool(np.all(np.linalg.norm(offsets, axis=1) < LIMIT * self._deviation_mm))


class FreeModel:
    """Points with velocities, initialised where all distances fit a pose of the robot.

    State: positions of all markers but M1, and their displacement per frame. It needs no rotation
    because distances do not depend on one.
    """

    _FLOOR_MM = 0.1, 0.15
    """Floors of M2 and of the tip; those between them follow in equal steps."""
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
        self.shapes = Shapes(geometry, distances)
        self._by_motors = np.abs(bending_of_motors(geometry))
        self._levers_mm = levers_mm(geometry)
        self._segments, freedoms = self._levers_mm.shape
        self._floor_mm = np.linspace(*self._FLOOR_MM, self._segments)
        room_mm = self._SHELL_MM2 * (self._RING_MM if self._segments > 1 else 1.0)
        turns = min(3 * self._segments - 1, 3)
        ranges = min(freedoms, 3 * self._segments - turns)
        constrained = 3 * self._segments - turns - ranges
        surface_mm = SURFACE_MM * math.sqrt(2.0 * math.pi)
        self.log_room = math.log(room_mm) + ranges * math.log(self._RANGE_MM)
        self.log_room += constrained * math.log(surface_mm)

    def started(self, found: Found) -> Belief:
        size = found.seen_mm.size
        mean = np.concatenate([found.seen_mm.ravel(), np.zeros(size)])
        covariance = np.diag([0.3**2] * size + [self._START_MM**2] * size)
        return Belief(mean, covariance, np.full(self._segments, self._START_MM))

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

    def expect(self, belief: Belief) -> tuple[Array, Array]:
        size = 3 * self._segments
        by_state = np.eye(size, 2 * size).reshape(-1, 3, 2 * size)
        return belief.mean[:size].reshape(-1, 3), by_state

    def surprise(self, correction: Array) -> Array:
        change_mm = correction[: 3 * self._segments].reshape(-1, 3)
        surprise: Array = np.linalg.norm(change_mm, axis=1) / math.sqrt(3.0) - self._NOISE_MM
        return surprise

    def holds(self, belief: Belief) -> bool:
        places, _ = self.expect(belief)
        apart_mm = np.linalg.norm(np.diff(places, axis=0, prepend=0.0), axis=1)
        return bool(within(apart_mm, self.shapes.tolerances.bounds_mm).all())
