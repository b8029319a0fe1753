"""The interface of a static model: what the law, its filter and its fit need of any robot.

``P`` are the parameters of a robot and ``S`` is its pose, with what backlash and friction remember;
both belong to the model. Motors are n, bending angles D.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.core.arrays import Array, BoolArray
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

PROBE = 1e-5
"""Perturbation of scores and setpoints, for derivatives."""


_LOOKS_AT_POSE, _FARTHEST_RAD = 3, 0.5
"""Iterations by which a pose that is seen is found, and the farthest change of an angle in each."""


class Sensitivity(NamedTuple):
    """``tip`` (3, K + 1), ``theta_rad`` (D, K + 1): a column for each of K scores, then time."""

    tip: Array
    theta_rad: Array


class Hold(NamedTuple):
    """Setpoints that hold a pose, (n,), and which tendon of each motor's pair pulls: 1 or -1."""

    setpoint_rad: Array
    sides: tuple[float, ...]


class SeenPose(NamedTuple):
    """The pose that markers show, whatever the motors and loads."""

    theta_rad: Array
    """Bending angles that bring the markers nearest to where they are, (D,)."""
    left_mm: Array
    """What then is left between them, (S, 3), NaN if not seen. No bending explains that."""
    by_markers: Array
    """Derivatives of the bending angles by the coordinates of the markers, (D, 3 S); 0 if
    unseen."""


@dataclass(frozen=True)
class PathPlan:
    """Bending angles at the knots of a path, (K, D), and the knots' step indices, (K,)."""

    knots: Array
    theta_rad: Array

    def bending_rad(self, index: float) -> Array:
        """Bending angles at a fractional step, (D,), interpolated linearly."""
        return np.array([np.interp(index, self.knots, column) for column in self.theta_rad.T])


class Resting(Protocol):
    """A pose at rest."""

    @property
    def theta_rad(self) -> Array:
        """Bending angles, (D,)."""
        ...


P = TypeVar("P")
S = TypeVar("S", bound=Resting)


_FROM_BOTH_SIDES = np.array([[1.0], [0.0], [-1.0], [0.0]])
"""Stops at each pose of a tour: past it, there, past it on the other side, there."""


class StaticModel(ABC, Generic[P, S]):
    """Rest poses of a robot, their derivatives and their inverse."""

    passed_rad = 0.0
    """Angle by which all motors turn past a rest of the tour, so that it is reached from both
    sides; 0 if it is reached straight from the one before."""

    @abstractmethod
    def first_pose(self, p: P, setpoint_rad: Array) -> S:
        """The pose at setpoints, (n,), without a history of motion."""

    @abstractmethod
    def moved(self, p: P, pose: S, duration_s: float, *setpoints_rad: Array) -> S:
        """The pose after straight motions of the setpoints, to each of these in turn, (n,).

        Each takes the same part of the time.
        """

    @abstractmethod
    def turned(self, p: P, pose: S, setpoint_rad: Array) -> S:
        """``moved`` as far as what the pose remembers needs it: bending angles may stay behind."""

    @abstractmethod
    def shifted(self, before: P, after: P, pose: S, theta_rad: Array) -> S:
        """The pose at the bending angles of a corrected model, (D,)."""

    @abstractmethod
    def tip_mm(self, p: P, theta_rad: Array) -> Array:
        """Tip in the camera's frame at bending angles, (D,) -> (3,)."""

    @abstractmethod
    def markers_mm(self, p: P, theta_rad: Array) -> Array:
        """Ends of the segments in the camera's frame, (K, S, 3), at bending angles, (K, D)."""

    def seen_pose(self, p: P, theta_rad: Array, seen_mm: Array) -> SeenPose:
        """The pose that markers show.

        Args:
            p: parameters of the robot.
            theta_rad: bending angles near by, (D,).
            seen_mm: ends of the segments in the camera's frame, (S, 3), NaN if not seen.
        """
        seen = np.isfinite(seen_mm)
        by_markers = np.zeros((len(theta_rad), seen.size))
        steps = PROBE * np.eye(len(theta_rad) + 1, len(theta_rad))
        for _ in range(_LOOKS_AT_POSE):
            near_mm = self.markers_mm(p, theta_rad + steps)[:, seen]
            slopes = (near_mm[:-1] - near_mm[-1]).T / PROBE
            by_seen = np.linalg.pinv(slopes, rcond=1e-3)
            change_rad = by_seen @ (seen_mm[seen] - near_mm[-1])
            theta_rad = theta_rad + np.clip(change_rad, -_FARTHEST_RAD, _FARTHEST_RAD)
        by_markers[:, seen.ravel()] = by_seen
        left_mm = seen_mm - self.markers_mm(p, theta_rad[None])[0]
        return SeenPose(theta_rad, left_mm, by_markers)

    @abstractmethod
    def turned_back_mm(self, p: P, seen_mm: Array) -> Array:
        """A vector of the camera's frame in the robot's, (3,)."""

    @abstractmethod
    def predicted_mm(self, p: P, rests: Rests) -> Array:
        """Ends of the segments at the rests, (N, ..., S, 3), of one or several (...) sets ``p``."""

    def predicted_and_slopes(
        self, space: ParameterSpace[P], score: Array, rests: Rests
    ) -> tuple[Array, Array]:
        """Ends of the segments at the rests, (N, S, 3), and their derivatives, (N, S, 3, COUNT).

        Those are by the scores, (COUNT,), of the robot.
        """
        near_mm = self.predicted_mm(space.perturbed(score, PROBE), rests)
        slopes = (near_mm[:, :-1] - near_mm[:, -1:]) / PROBE
        return near_mm[:, -1], np.moveaxis(slopes, 1, -1)

    @abstractmethod
    def sensitivity(
        self,
        space: ParameterSpace[P],
        score: Array,
        numbers: Sequence[int],
        p: P,
        pose: S,
        rate_rad_s: Array,
    ) -> Sensitivity:
        """Derivatives of the tip and the bending angles at rest in parameters and setpoints.

        Args:
            space: of the parameters.
            score: scores of the parameters, (COUNT,).
            numbers: those of the scores by which derivatives are taken, K.
            p: the parameters themselves.
            pose: pose at rest.
            rate_rad_s: rate of the setpoints, (n,), for the last column, a speed.
        """

    @abstractmethod
    def hold(
        self,
        p: P,
        pose: S,
        theta_rad: Array,
        sides: tuple[float, ...],
        change_over: tuple[float, ...],
    ) -> Hold:
        """The setpoints that hold bending angles, (D,), the inverse of rest.

        Args:
            p: parameters of the robot.
            pose: present pose.
            theta_rad: bending angles to hold.
            sides: which tendon of each motor's pair has pulled so far; 0 for none.
            change_over: moment that the other tendon must have to supply before it takes over.
        """

    @abstractmethod
    def unhindered_rad(self, p: P, theta_rad: Array) -> Array:
        """Setpoints that hold bending angles without friction and backlash, (..., n)."""

    @abstractmethod
    def nearest(self, p: P, planned_rad: Array, shift_rad: Array, aim_mm: Array) -> Array:
        """Bending angles of the pose nearest to a point, (D,).

        Args:
            p: parameters of the robot.
            planned_rad: planned bending angles, (D,).
            shift_rad: difference to them of the last pose, (D,).
            aim_mm: the point in the robot's frame, (3,).
        """

    @abstractmethod
    def plan(self, p: P, limits: MotorLimits, reference: Reference, knots: Array) -> PathPlan:
        """A continuous sequence of poses along a path; ``knots`` are step indices, (K,)."""

    @abstractmethod
    def tour_rad(self, p: P, limits: MotorLimits) -> Array:
        """Motor angles of rests at which the parameters are observable, (N, n)."""

    def tour(self, p: P, limits: MotorLimits) -> tuple[Array, BoolArray]:
        """Motor angles of stops by which to reach those rests, (K, n); which are rests, (K,)."""
        rests_rad = self.tour_rad(p, limits)
        if not self.passed_rad:
            return rests_rad, np.ones(len(rests_rad), dtype=np.bool_)
        stops_rad = rests_rad[:, None] + self.passed_rad * _FROM_BOTH_SIDES
        are_rests = np.tile(_FROM_BOTH_SIDES[:, 0] == 0.0, len(rests_rad))
        return limits.clip(stops_rad.reshape(-1, rests_rad.shape[1])), are_rests


class PoseFollower(Generic[P, S]):
    """Follows a history of setpoints completely, as backlash and friction depend on every turn.

    It is followed from ``time_s`` on.
    """

    def __init__(
        self, model: StaticModel[P, S], p: P, history: SetpointHistory, time_s: float
    ) -> None:
        self._model = model
        self._history = history
        self._time_s = time_s
        self.pose = model.first_pose(p, history.at(time_s))

    def advance_to(self, p: P, time_s: float) -> S:
        """The pose at a time, or the present one if that is later."""
        if time_s > self._time_s:
            corners_rad = self._history.corners(self._time_s, time_s)
            self.pose = self._model.moved(p, self.pose, time_s - self._time_s, *corners_rad)
            self._time_s = time_s
        return self.pose

    def ahead(self, p: P) -> S:
        """Backlash and friction after all commands; the bending angles need not be updated."""
        pose = self.pose
        for setpoint_rad in self._history.corners(self._time_s, math.inf):
            pose = self._model.turned(p, pose, setpoint_rad)
        return pose
