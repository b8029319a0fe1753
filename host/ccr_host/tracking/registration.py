"""Registration: the rotation from the camera's frame to that of (10), from poses at rest.

The robot at rest is 20 mm and more away from (10), so fitting (10) to its poses would turn the
frame by several degrees. Instead, properties are used that hold regardless of slack and gravity:

- M2 moves in a plane, whose normal is the x of (10). M3 does not if segment 2 is bent, for
  example by a servo's zero offset: its sag then varies as segment 1 swings.
- The part of M3 - M2 in that plane points along the tangent at the end of segment 1.
- Between its two end tangents, segment 1 is an arc that sags by one unknown load
  (``chord``): this gives the tangent at the base, -y of (10).
- The markers stand on the +z side.

Motor angles are only used to find out which motors turn the wrong way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Robot
from ccr_host.robot.rests import Rests

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SHAPE_ERROR_MM = 0.1
"""Residual of the sagging arc on twins with half to 1.5 times the default loads."""
_LENGTH_TOLERANCE_MM = 0.5
"""Print, glue and centre of a marker, standard deviation: of L_1, of the heights of M1 and M2."""
_LOAD_PRIOR = (0.35, 1.0)
"""Mean and standard deviation; the paper's robot has about 0.4, and hanging ones less than 0."""
_SAME_ANGLE_RAD = math.radians(0.5)
_STARTS = 12
_POINTS = 41
"""Points along a sagging segment."""
_SWEEPS = 3
"""Each gains a factor of about ten; three are exact to 0.01 mm up to a load of 1."""

MIN_POSES = 5
MIN_SWING_RAD = math.radians(60.0)
"""Least swing of segment 1 over all poses; below it sag and rotation cannot be told apart."""
MIN_SIDEWAYS_MM = 5.0
"""Least motion of M3 between the two ends of motor 2."""
MAX_BASE_MOTION_MM = 1.0
MAX_RESIDUAL_MM = 0.6
MAX_UNCERTAINTY_DEG = 1.5
"""1 deg moves the tip by 1.8 mm where the robot is straight."""
MAX_SCALE_ERROR = 0.03
MAX_SEGMENT_ERROR_MM = 2.0
_MIN_MIRROR_RATIO = 3.0


class RegistrationError(CcrError):
    """The poses do not determine a trustworthy rotation (exit status 3)."""


@dataclass(frozen=True, eq=False)
class Registration:
    """Rotation of the camera with its uncertainty."""

    camera_to_robot: Array
    """(3, 3): turns vectors of the camera's frame into that of (10)."""
    uncertainty_deg: Array
    """(3,): standard deviation about x, y and z of (10)."""
    residual_mm: float
    """RMS distance of the markers from the fitted shapes."""
    scale: float
    """Measured length of segment 2 divided by its configured length. Slack and gravity do not
    change the distance between its markers while its motor rests."""
    segment_1_mm: float
    """L_1 as measured."""
    load: float
    """See ``chord``."""
    base_marker_aside_mm: float
    """Distance of M1 from the plane in which segment 1 bends."""
    reversed_motors: tuple[int, ...]
    """Numbers of the motors that turn against their description, 1 or 2."""

    @property
    def camera_to_robot_deg(self) -> Array:
        """(3,): the rotation as a rotation vector in degrees."""
        vector: Array = Rotation.from_matrix(self.camera_to_robot).as_rotvec(degrees=True)
        return vector


def register(rests: Rests, geometry: Robot) -> Registration:
    """Fit the rotation and judge it.

    Args:
        rests: at least `MIN_POSES`, in the camera's frame; segment 1 swung both ways with motor 2
            at one angle, and motor 2 turned both ways.
        geometry: the robot as the controller believes it.

    Raises:
        RegistrationError: coverage, residual, scale or uncertainty is poor; the message says which,
            why, and what to do.
    """
    seen = _Vectors.of(rests)
    _require_coverage(seen)
    plane = _fit_plane(seen)
    fit = _fit_shape(seen, plane, geometry)
    scale = float(np.mean(np.linalg.norm(seen.along_2[seen.straight_2], axis=1)))
    result = Registration(
        camera_to_robot=fit.camera_to_robot,
        uncertainty_deg=np.degrees([fit.turn_sigma_rad, *_tilt_sigma_rad(plane, fit)]),
        residual_mm=math.hypot(plane.residual_mm, fit.residual_mm),
        scale=scale / geometry.segment_lengths_mm[1],
        segment_1_mm=geometry.segment_lengths_mm[0] + fit.length_error_mm,
        load=fit.load,
        base_marker_aside_mm=plane.base_aside_mm,
        reversed_motors=_reversed_motors(seen, fit),
    )
    _require_quality(result, geometry)
    return result


@dataclass(frozen=True, eq=False)
class _Vectors:
    """What K poses show, independent of the position of the camera."""

    q_rad: Array
    """(K, 2)."""
    along_1: Array
    """(K, 3): M2 - M1."""
    along_2: Array
    """(K, 3): M3 - M2."""
    straight_2: NDArray[np.bool_]
    """(K,): motor 2 stands at its most frequent angle."""

    @classmethod
    def of(cls, rests: Rests) -> _Vectors:
        q_rad, markers = rests.q_rad, rests.markers_mm
        if len(q_rad) < MIN_POSES:
            raise RegistrationError(
                f"only {len(q_rad)} poses with all three markers, {MIN_POSES} are needed",
                "check line of sight and the camera's volume",
            )
        _require_resting_base(markers[:, 0])
        near = np.abs(q_rad[:, 1, None] - q_rad[None, :, 1]) < _SAME_ANGLE_RAD
        most_frequent = near[np.argmax(near.sum(axis=1))]
        return cls(
            q_rad, markers[:, 1] - markers[:, 0], markers[:, 2] - markers[:, 1], most_frequent
        )


@dataclass(frozen=True, eq=False)
class _Plane:
    """The plane in which segment 1 bends; its normal is x of (10) up to the sign."""

    normal: Array
    scatter: Array
    """(3, 3): sum of squares of the distances from it is n' scatter n, mm^2."""
    residual_mm: float
    base_aside_mm: float


@dataclass(frozen=True, eq=False)
class _Shape:
    camera_to_robot: Array
    bending_rad: Array
    """(K,): of segment 1."""
    load: float
    length_error_mm: float
    residual_mm: float
    turn_sigma_rad: float


def _require_resting_base(base_mm: Array) -> None:
    moved_mm = float(np.max(np.linalg.norm(base_mm - np.median(base_mm, axis=0), axis=1)))
    if moved_mm > MAX_BASE_MOTION_MM:
        raise RegistrationError(
            f"M1 moved by {moved_mm:.1f} mm between poses",
            "fix base and camera, and keep clear of them during the measurement",
        )


def _require_coverage(seen: _Vectors) -> None:
    directions = seen.along_2[seen.straight_2]
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    swing_rad = float(np.arccos(np.clip(np.min(directions @ directions.T), -1.0, 1.0)))
    if swing_rad < MIN_SWING_RAD:
        raise RegistrationError(
            f"segment 1 swung by {math.degrees(swing_rad):.0f} deg only, "
            f"{math.degrees(MIN_SWING_RAD):.0f} are needed",
            "check servo power and that tendons 1 and 3 are on servo 1; tighten them; "
            "or widen servo.angle_min_deg and angle_max_deg",
        )
    sideways = np.ptp(seen.q_rad[:, 1])
    if sideways < 2 * _SAME_ANGLE_RAD:
        raise RegistrationError(
            "motor 2 was never turned, so its direction cannot be checked",
            "widen servo.angle_min_deg and angle_max_deg of axis 2",
        )


def _fit_plane(seen: _Vectors) -> _Plane:
    """Fit the normal to the positions of M2; a constant offset allows for markers glued by hand."""
    places = seen.along_1
    prior_weight = (_SHAPE_ERROR_MM / _LENGTH_TOLERANCE_MM) ** 2
    total = places.sum(axis=0)
    scatter = places.T @ places - np.outer(total, total) / (len(places) + prior_weight)
    normal = np.linalg.eigh(scatter)[1][:, 0]
    aside_mm = places @ normal
    return _Plane(normal, scatter, float(np.std(aside_mm)), abs(float(np.mean(aside_mm))))


def _tilt_sigma_rad(plane: _Plane, fit: _Shape) -> tuple[float, float]:
    """Standard deviations about y and z of (10), which tilt x."""
    sigma_mm = max(_SHAPE_ERROR_MM, plane.residual_mm)
    axes = fit.camera_to_robot[1:]
    # Turning about y moves x along z, and the other way round.
    covariance = np.linalg.inv(axes @ plane.scatter @ axes.T) * sigma_mm**2
    return math.sqrt(covariance[1, 1]), math.sqrt(covariance[0, 0])


def _fit_shape(seen: _Vectors, plane: _Plane, geometry: Robot) -> _Shape:
    """Fit the base tangent for both choices of +x; the side on which the markers stand decides."""
    one, other = (_fit_sided(seen, side * plane.normal, geometry) for side in (1.0, -1.0))
    better, worse = sorted((one, other), key=lambda fit: fit.residual_mm)
    if worse.residual_mm < _MIN_MIRROR_RATIO * better.residual_mm:
        raise RegistrationError(
            f"the markers do not tell up from down (residuals of {better.residual_mm:.1f} and "
            f"{worse.residual_mm:.1f} mm)",
            "check robot.marker_offset_mm and that all markers stand on the same side",
        )
    return better


def _fit_sided(seen: _Vectors, normal: Array, geometry: Robot) -> _Shape:
    across = np.linalg.svd(normal[None])[2][1]
    upwards = np.cross(across, normal)
    # Right-handed with x = normal, y = -across, z = upwards; s = -f[1] + i f[2] as in kinematics.
    to_marker_2: ComplexArray = seen.along_1 @ across + 1j * (seen.along_1 @ upwards)
    tangent_rad = np.angle(seen.along_2 @ across + 1j * (seen.along_2 @ upwards))
    length_mm = geometry.segment_lengths_mm[0]
    offset_mm = geometry.marker_offset_mm

    def bending_rad(turn: float) -> Array:
        return np.asarray(np.angle(np.exp(1j * (tangent_rad - turn))), dtype=np.float64)

    def residuals(unknowns: Array) -> Array:
        turn, load, length_error, height_error = unknowns
        bending = bending_rad(turn)
        tilt = np.exp(1j * bending)
        shape = (
            (length_mm + length_error) * chord(bending, load)
            + 1j * (offset_mm + height_error) * tilt
            - 1j * offset_mm
        )
        misfit = (to_marker_2 - np.exp(1j * turn) * shape) / _SHAPE_ERROR_MM
        priors = [
            length_error / _LENGTH_TOLERANCE_MM,
            height_error / (math.sqrt(2) * _LENGTH_TOLERANCE_MM),
            (load - _LOAD_PRIOR[0]) / _LOAD_PRIOR[1],
        ]
        return np.concatenate([misfit.real, misfit.imag, priors])

    starts = np.linspace(-math.pi, math.pi, _STARTS, endpoint=False)
    guesses = [np.array([turn, _LOAD_PRIOR[0], 0.0, 0.0]) for turn in starts]
    guess = min(guesses, key=lambda at: float(np.sum(residuals(at) ** 2)))
    best = least_squares(residuals, guess, method="lm")
    turn, load, length_error, _ = best.x
    misfit_mm = best.fun[: 2 * len(seen.q_rad)] * _SHAPE_ERROR_MM
    residual_mm = float(np.sqrt(np.mean(misfit_mm**2)))
    sigma = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    sigma *= max(1.0, residual_mm / _SHAPE_ERROR_MM)
    base_tangent = math.cos(turn) * across + math.sin(turn) * upwards
    return _Shape(
        camera_to_robot=np.stack([normal, -base_tangent, np.cross(normal, -base_tangent)]),
        bending_rad=bending_rad(turn),
        load=float(load),
        length_error_mm=float(length_error),
        residual_mm=residual_mm,
        turn_sigma_rad=float(sigma[0]),
    )


def _reversed_motors(seen: _Vectors, fit: _Shape) -> tuple[int, ...]:
    """Positive angles lift the tip and move it towards +x.

    Raises:
        RegistrationError: motor 2 moves nothing.
    """
    sideways_mm = seen.along_2 @ fit.camera_to_robot[0]
    lowest, highest = np.argmin(seen.q_rad[:, 1]), np.argmax(seen.q_rad[:, 1])
    moved_mm = float(sideways_mm[highest] - sideways_mm[lowest])
    if abs(moved_mm) < MIN_SIDEWAYS_MM:
        raise RegistrationError(
            f"segment 2 moved M3 by {abs(moved_mm):.1f} mm only",
            "check that tendons 2 and 4 are on servo 2; tighten them",
        )
    lifting = float(
        np.polyfit(seen.q_rad[seen.straight_2, 0], fit.bending_rad[seen.straight_2], 1)[0]
    )
    return tuple(motor for motor, way in ((1, lifting), (2, moved_mm)) if way < 0)


def _require_quality(result: Registration, geometry: Robot) -> None:
    if result.residual_mm > MAX_RESIDUAL_MM:
        raise RegistrationError(
            f"the markers are {result.residual_mm:.2f} mm (RMS) off any shape of the robot, "
            f"{MAX_RESIDUAL_MM} are allowed",
            "check that markers and base sit firmly and that robot.* are the robot's measures",
        )
    if abs(result.scale - 1.0) > MAX_SCALE_ERROR:
        length_mm = geometry.segment_lengths_mm[1]
        raise RegistrationError(
            f"segment 2 measures {result.scale * length_mm:.1f} mm instead of {length_mm:g}",
            "correct robot.segment_lengths_mm, or check the camera's calibration",
        )
    length_mm = geometry.segment_lengths_mm[0]
    if abs(result.segment_1_mm - length_mm) > MAX_SEGMENT_ERROR_MM:
        raise RegistrationError(
            f"segment 1 measures {result.segment_1_mm:.1f} mm instead of {length_mm:g}",
            "correct robot.segment_lengths_mm and robot.marker_offset_mm",
        )
    worst_deg = float(np.max(result.uncertainty_deg))
    if worst_deg > MAX_UNCERTAINTY_DEG:
        raise RegistrationError(
            f"the rotation is uncertain by {worst_deg:.1f} deg, {MAX_UNCERTAINTY_DEG} are allowed",
            "widen the servo's limits so that the robot can swing further, or lower the noise",
        )


def chord(bending_rad: Array, load: float) -> ComplexArray:
    """Vectors from start to end of segments of unit length that bend by ``bending_rad``, (K,).

    (10) assumes uniform curvature. At rest the moment of the tendons is indeed uniform along the
    segment, but that of the weight it carries decreases towards its end:
    theta'(s) = c + w X(s), where s and X (the distance from the base along the straight robot) are
    in segment lengths. c comprises the tendons, their slack and the lever of the load; it is not an
    unknown, as the bending angle is measured in each pose. One unknown is left for all poses, the
    load w = weight beyond the segment x length / bending stiffness.

    Returns:
        Complex numbers in the bending plane: the real axis is the direction of the straight
        segment, the imaginary one points against gravity. Without load the unit arc of (10).
    """
    along = np.linspace(0.0, 1.0, _POINTS)
    even = bending_rad[:, None] * along
    angle = even
    for _ in range(_SWEEPS):
        curvature = load * cumulative_trapezoid(np.cos(angle), along, initial=0.0)
        uneven = cumulative_trapezoid(curvature, along, initial=0.0)
        angle = even + uneven - along * uneven[:, -1:]
    # The trapezoid rule shortens an arc by theta^2 / (12 n^2), 0.03 % at 90 deg.
    total: ComplexArray = trapezoid(np.exp(1j * angle), along)
    return total
