"""Priors for labelling: where the markers of a tendon-driven robot can be and how they can move.

Two models share one interface. `ChainModel` needs the camera's rotation and models the whole robot;
`FreeModel` needs no rotation and models distances only. Both treat motor motion only as a hint that
something moves, because slack and gravity determine how far the tip moves.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Robot
from ccr_host.robot.arc import arc_derivatives_at

Array = NDArray[np.float64]

FRAME_S = 0.05
"""Process noise is stated for the 20 Hz of a Polaris and scaled to other intervals."""
_CALMING = 0.7
"""Decay of the agitation per frame: ringing a few frames ago still widens the gates."""
_MOTOR_SHARE = 0.5
"""Standard deviation of the motion caused by a motor, as a fraction of (4), (5)."""
_BELIEVED_BENDING_SIGMA_RAD = 0.7
"""Slack, sag and servo lag between believed and true bending; 0.3 to 0.5 were seen on the twin."""

_MODEL_MM = 2.5
"""Deviation of M2 from constant curvature: sag, rotation error, glue."""
_SEGMENT_2_MM = 1.0
"""The same for M3 relative to M2."""
_LIMIT = 3.5
"""Standard deviations beyond which a pose cannot be this robot's."""
_SPHERE_MM = 11.5
"""Two of NDI's passive spheres cannot be closer to each other."""
_ROOM_MM2 = 280.0 * 120.0
"""About the area that M2 and M3 sweep together along their two degrees of freedom, mm x mm."""


M2_ROWS = slice(0, 3)
M3_ROWS = slice(3, 6)


@dataclass(frozen=True, eq=False)
class Belief:
    """State of a motion model."""

    mean: Array
    """(n,)."""
    covariance: Array
    """(n, n)."""
    agitation: Array
    """(2,): decaying maximum of recent deviations from the expected pose; units of the model."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Expected position of M2 and M3 relative to M1: six coordinates."""

    mean_mm: Array
    """(6,): M2, M3."""
    covariance_mm2: Array
    """(6, 6), excluding the camera's noise."""
    jacobian: Array
    """(6, n): derivative of the expectation with respect to the state."""


def expectation(belief: Belief, mean_mm: Array, jacobian: Array) -> Expectation:
    """Propagate the covariance of the state to the markers."""
    return Expectation(mean_mm, jacobian @ belief.covariance @ jacobian.T, jacobian)


def corrected(
    belief: Belief, expected: Expectation, rows: Array, seen_mm: Array, noise_mm: float
) -> tuple[Array, Array]:
    """Kalman update with some of the six coordinates; returns the new mean and covariance.

    Args:
        belief: prior belief.
        expected: expectation of that belief.
        rows: indices of the measured coordinates.
        seen_mm: the measured coordinates.
        noise_mm: the camera's noise per coordinate.
    """
    jacobian = expected.jacobian[rows]
    innovation_covariance = expected.covariance_mm2[np.ix_(rows, rows)] + noise_mm**2 * np.eye(
        len(rows)
    )
    gain = np.linalg.solve(innovation_covariance, jacobian @ belief.covariance).T
    mean = belief.mean + gain @ (seen_mm - expected.mean_mm[rows])
    covariance = belief.covariance - gain @ innovation_covariance @ gain.T
    return mean, 0.5 * (covariance + covariance.T)


class Bounds(NamedTuple):
    """Bounds of the distances between markers for every pose and camera, mm."""

    between_1_and_2: tuple[float, float]
    between_2_and_3: tuple[float, float]

    @classmethod
    def of(cls, geometry: Robot) -> Bounds:
        """Bounds of a robot, with tolerance for glue, noise and sag."""
        length_1, length_2 = geometry.segment_lengths_mm
        offset = geometry.marker_offset_mm
        # A chord is never longer than its arc; past 1.2 half turns nothing of use is reached.
        return cls(
            (_SPHERE_MM, math.hypot(length_1, 2.0 * offset) + 4.0 * _MODEL_MM),
            (_SPHERE_MM, length_2 + 2.0 * _SEGMENT_2_MM),
        )


class Seed(NamedTuple):
    """A pose derived from one pair of points."""

    belief: Belief
    log_density: float
    """Logarithm of the prior density of that pair, in 1/mm^6."""


class MotionModel(Protocol):
    """Prior of M2 and M3 relative to M1."""

    bounds: Bounds

    def seeds(self, marker_2_mm: Array, marker_3_mm: Array, q_rad: Array) -> Iterator[Seed]:
        """Poses that put M2 and M3 at two points, without any history."""

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        """The belief after `duration_s`, during which the motors were commanded to move, (2,)."""

    def expect(self, belief: Belief) -> Expectation:
        """Expected marker positions of a belief."""

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        """The belief with a corrected mean and covariance; updates the agitation."""

    def holds(self, belief: Belief) -> bool:
        """Whether the pose is possible at all, regardless of its history."""


class ChainModel:
    """Constant curvature with free bending angles and slowly varying offsets.

    State: theta_1, theta_2; offset of M2 from its curve; offset of M3 from its modelled position
    relative to M2. It discriminates well because, whatever the tendons do, M2 moves on a curve and
    M3 - M2 on a small surface: a pair of points has to satisfy four constraints, and each marker
    gives information on the other.
    Vectors are in the robot's frame.
    """

    _FLOOR_RAD = np.array([0.003, 0.006])
    _OFFSET_WALK_MM = 0.12
    _OFFSET_WALK_2_MM = 0.06
    _OFFSET_PER_RAD = np.array([2.5, 2.0])
    """Change of the offsets with the bending angles, mm/rad."""
    _START_RAD = 0.03
    _NOISE_RAD = np.array([0.004, 0.006])
    """Size of the corrections caused by the camera's noise alone."""

    def __init__(self, geometry: Robot) -> None:
        self.bounds = Bounds.of(geometry)
        self._length_1, self._length_2 = geometry.segment_lengths_mm
        self._offset = geometry.marker_offset_mm
        self._gain = geometry.pulley_radius_mm / geometry.tendon_radius_mm

    def seeds(self, marker_2_mm: Array, marker_3_mm: Array, q_rad: Array) -> Iterator[Seed]:
        along = marker_3_mm - marker_2_mm
        across, sagittal = float(along[0]), complex(-along[1], along[2])
        # The chord of an arc points along half its angle; past a half turn its end turns back.
        for side in (1.0, -1.0):
            tangent = side * sagittal
            theta_1 = cmath.phase(tangent) if tangent else 0.0
            theta_2 = 2.0 * math.atan2(across, side * abs(sagittal))
            seed = self._seed(theta_1, theta_2, marker_2_mm, marker_3_mm, q_rad)
            if seed is not None:
                yield seed

    def _seed(
        self, theta_1: float, theta_2: float, marker_2: Array, marker_3: Array, q_rad: Array
    ) -> Seed | None:
        place_2, place_3, _ = self._places(theta_1, theta_2)
        offset_2 = marker_2 - place_2
        offset_3 = marker_3 - marker_2 - (place_3 - place_2)
        # Two components of M2's offset count, and one of M3's: the others determined the angles.
        misfits = np.array([offset_2[0], np.hypot(*offset_2[1:])]) / _MODEL_MM
        misfit_3 = float(np.linalg.norm(offset_3)) / _SEGMENT_2_MM
        beyond = (np.array([theta_1, theta_2]) - self._gain * q_rad) / _BELIEVED_BENDING_SIGMA_RAD
        if max(np.max(np.abs(misfits)), misfit_3, np.max(np.abs(beyond))) > _LIMIT:
            return None
        exponent = -0.5 * float(misfits @ misfits + misfit_3**2 + beyond @ beyond)
        constants = math.log(_MODEL_MM**2 * _SEGMENT_2_MM**2 * _ROOM_MM2 * (2 * math.pi) ** 2)
        mean = np.concatenate([[theta_1, theta_2], offset_2, offset_3])
        covariance = np.diag([self._START_RAD**2] * 2 + [0.5**2] * 3 + [0.3**2] * 3)
        belief = Belief(mean, covariance, np.full(2, self._START_RAD))
        return Seed(belief, exponent - constants)

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        frames = duration_s / FRAME_S
        stir = _MOTOR_SHARE * self._gain * np.abs(motor_motion_rad)
        turn = np.hypot(np.hypot(self._FLOOR_RAD, belief.agitation), stir) * math.sqrt(frames)
        walk = np.hypot(
            np.array([self._OFFSET_WALK_MM, self._OFFSET_WALK_2_MM]) * math.sqrt(frames),
            self._OFFSET_PER_RAD * turn,
        )
        covariance = belief.covariance.copy()
        covariance[np.diag_indices(8)] += np.repeat([*turn, *walk], [1, 1, 3, 3]) ** 2
        return Belief(belief.mean, covariance, belief.agitation * _CALMING**frames)

    def expect(self, belief: Belief) -> Expectation:
        theta_1, theta_2 = belief.mean[:2]
        place_2, place_3, jacobian = self._places(float(theta_1), float(theta_2))
        offset_2, offset_3 = belief.mean[2:5], belief.mean[5:8]
        mean = np.concatenate([place_2 + offset_2, place_3 + offset_2 + offset_3])
        return expectation(belief, mean, jacobian)

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        surprise = np.maximum(np.abs(mean[:2] - before.mean[:2]) - self._NOISE_RAD, 0.0)
        return Belief(mean, covariance, np.maximum(before.agitation, surprise))

    def holds(self, belief: Belief) -> bool:
        offset_2, offset_3 = belief.mean[2:5], belief.mean[5:8]
        return bool(
            np.linalg.norm(offset_2) < _LIMIT * _MODEL_MM
            and np.linalg.norm(offset_3) < _LIMIT * _SEGMENT_2_MM
        )

    def _places(self, theta_1: float, theta_2: float) -> tuple[Array, Array, Array]:
        """Modelled M2 and M3, (3,) each, and their Jacobian with respect to the state, (6, 8)."""
        arc_1, slope_1 = arc_derivatives_at(theta_1)[:2]
        arc_2, slope_2 = arc_derivatives_at(theta_2)[:2]
        turn = cmath.exp(1j * theta_1)
        place_2 = self._length_1 * arc_1 + 1j * self._offset * (turn - 1.0)
        by_1 = self._length_1 * slope_1 - self._offset * turn
        along_2 = self._length_2 * arc_2.real * turn
        by_2 = self._length_2 * slope_2.real * turn
        jacobian = np.zeros((6, 8))
        jacobian[1:3, 0] = -by_1.real, by_1.imag
        end_by_1 = by_1 + 1j * along_2
        jacobian[4:6, 0] = -end_by_1.real, end_by_1.imag
        jacobian[3:6, 1] = self._length_2 * slope_2.imag, -by_2.real, by_2.imag
        jacobian[:3, 2:5] = jacobian[3:, 2:5] = jacobian[3:, 5:] = np.eye(3)
        end = place_2 + along_2
        return (
            np.array([0.0, -place_2.real, place_2.imag]),
            np.array([self._length_2 * arc_2.imag, -end.real, end.imag]),
            jacobian,
        )


class FreeModel:
    """Two points with velocities, initialised where the three distances fit a pose of the robot.

    State: positions of M2 and M3, and their displacement per frame. It needs no rotation because
    distances do not depend on one.
    """

    _FLOOR_MM = np.array([0.1, 0.15])
    _START_MM = 1.5
    _NOISE_MM = 0.2
    """Size of the corrections caused by the camera's noise alone."""
    _PUSH = 0.5
    """Change of the displacement per frame, as a fraction of the change of position."""
    _SURFACE_MM = 3.0
    """Deviation of |M3 - M1| in (10) from a sagging robot's, given |M2 - M1| and |M3 - M2|."""
    _SHELL_MM2 = 4.0 * math.pi * 50.0**2
    """Area on which M2 can lie about M1 when nothing is known about the camera's rotation."""
    _RING_MM = 2.0 * math.pi * 30.0
    """Length of the ring on which M3 can then lie at given distances."""
    _RANGES_MM2 = 50.0 * 20.0
    """Ranges of |M2 - M1| and |M3 - M2|."""

    def __init__(self, geometry: Robot) -> None:
        self.bounds = Bounds.of(geometry)
        self._length_1, self._length_2 = geometry.segment_lengths_mm
        self._offset = geometry.marker_offset_mm
        self._gain = geometry.pulley_radius_mm / geometry.tendon_radius_mm
        # Largest swing of M2 and M3 with their segments' bending, mm/rad.
        reach = self._length_1 + self._offset
        self._levers_mm = np.array([[reach, 0.0], [reach + self._length_2, self._length_2]])
        self._table_rad = np.linspace(-math.pi, math.pi, 721)
        self._distance_12 = np.array([abs(self._place_2(t)) for t in self._table_rad])

    def seeds(self, marker_2_mm: Array, marker_3_mm: Array, q_rad: Array) -> Iterator[Seed]:
        distance_12 = float(np.linalg.norm(marker_2_mm))
        distance_13 = float(np.linalg.norm(marker_3_mm))
        distance_23 = float(np.linalg.norm(marker_3_mm - marker_2_mm))
        believed = self._gain * q_rad
        theta_1 = self._bending_1(distance_12, float(believed[0]))
        theta_2 = self._bending_2(distance_23)
        if theta_1 is None or theta_2 is None:
            return
        place_3 = self._place_2(theta_1) + self._length_2 * arc_derivatives_at(theta_2)[
            0
        ].real * cmath.exp(1j * theta_1)
        across = self._length_2 * arc_derivatives_at(theta_2)[0].imag
        misfit = (math.hypot(abs(place_3), across) - distance_13) / self._SURFACE_MM
        beyond = (
            np.array([theta_1 - believed[0], theta_2 - abs(believed[1])])
            / _BELIEVED_BENDING_SIGMA_RAD
        )
        if max(abs(misfit), float(np.max(np.abs(beyond)))) > _LIMIT:
            return
        exponent = -0.5 * float(misfit**2 + beyond @ beyond)
        room = self._SHELL_MM2 * self._RING_MM * self._RANGES_MM2
        constants = math.log(self._SURFACE_MM * math.sqrt(2 * math.pi) * room)
        mean = np.concatenate([marker_2_mm, marker_3_mm, np.zeros(6)])
        covariance = np.diag([0.3**2] * 6 + [self._START_MM**2] * 6)
        yield Seed(Belief(mean, covariance, np.full(2, self._START_MM)), exponent - constants)

    def moved(self, belief: Belief, duration_s: float, motor_motion_rad: Array) -> Belief:
        frames = duration_s / FRAME_S
        stir = _MOTOR_SHARE * self._gain * self._levers_mm @ np.abs(motor_motion_rad)
        kick = np.hypot(np.hypot(self._FLOOR_MM, belief.agitation), stir)
        step = np.eye(12)
        step[:6, 6:] = frames * np.eye(6)
        covariance = step @ belief.covariance @ step.T
        variance = np.repeat(kick, 3) ** 2
        covariance[np.diag_indices(12)] += frames * np.concatenate(
            [variance, self._PUSH**2 * variance]
        )
        return Belief(step @ belief.mean, covariance, belief.agitation * _CALMING**frames)

    def expect(self, belief: Belief) -> Expectation:
        return expectation(belief, belief.mean[:6], np.eye(6, 12))

    def settled(self, before: Belief, mean: Array, covariance: Array) -> Belief:
        change = (mean[:6] - before.mean[:6]).reshape(2, 3)
        surprise = np.linalg.norm(change, axis=1) / math.sqrt(3.0) - self._NOISE_MM
        return Belief(mean, covariance, np.maximum(before.agitation, surprise))

    def holds(self, belief: Belief) -> bool:
        marker_2, marker_3 = belief.mean[:3], belief.mean[3:6]
        distances = (np.linalg.norm(marker_2), np.linalg.norm(marker_3 - marker_2))
        return all(
            low <= distance <= high
            for distance, (low, high) in zip(distances, self.bounds, strict=True)
        )

    def _place_2(self, theta_1: float) -> complex:
        arc = arc_derivatives_at(theta_1)[0]
        return self._length_1 * arc + 1j * self._offset * (cmath.exp(1j * theta_1) - 1.0)

    def _bending_1(self, distance_mm: float, believed_rad: float) -> float | None:
        """The bending angle closest to the believed one among those that fit |M2 - M1|."""
        fits = np.abs(self._distance_12 - distance_mm) < _MODEL_MM
        if not np.any(fits):
            return None
        candidates = self._table_rad[fits]
        return float(candidates[np.argmin(np.abs(candidates - believed_rad))])

    def _bending_2(self, distance_mm: float) -> float | None:
        """Magnitude of the bending: |M3 - M2| = L_2 sinc(theta_2 / 2), never more than L_2."""
        share = distance_mm / self._length_2
        if share > 1.0 + 2.0 * _SEGMENT_2_MM / self._length_2:
            return None
        angles = np.linspace(0.0, 1.2 * math.pi, 400)
        shares = np.sinc(angles / (2.0 * math.pi))
        nearest = int(np.argmin(np.abs(shares - share)))
        misfit_mm = abs(shares[nearest] - share) * self._length_2
        return float(angles[nearest]) if misfit_mm < 2.0 * _SEGMENT_2_MM else None
