"""Registration: the rotation from the camera's frame to that of (10), from poses at rest.

The robot at rest is 20 mm and more away from (10), so fitting (10) to its poses would turn the
frame by several degrees. Instead, properties are used that hold regardless of slack and gravity:

- M2 moves in a plane, whose normal is the x of (10). M3 does not if segment 2 is bent, for
  example by a servo's zero offset: its sag then varies as segment 1 swings.
- The part of M3 - M2 in that plane points along the tangent at the end of segment 1.
- Between its two end tangents, segment 1 is an arc bent unevenly by its load, a taper of its
  stiffness and the friction of its tendons (``uneven_arc.py``): a few unknowns for all poses, with
  which this gives the tangent at the base, -y of (10). Friction acts the other way when a pose is
  approached from its other side, so poses are approached from both.
- The markers stand on the +z side.

Motor angles are only used to find out from which side a pose was approached, and which motors
turn the wrong way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Robot
from ccr_host.robot.rests import Rests
from ccr_host.tracking.uneven_arc import UnevenArc, chord

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SHAPE_ERROR_MM = 0.05
"""Residual of the arc on chains of six hinges, with the noise of thirty exposures of 0.25 mm."""
_ARC_ERROR_RAD = math.radians(0.2)
"""RMS error on such chains with friction to 0.4, taper to 0.3 and gravity from any side."""
_LENGTH_TOLERANCE_MM = 0.5
"""Print, and centre of a marker along the robot: standard deviation of L_1."""
_HEIGHT_TOLERANCE_MM = 0.3
"""Posts and glue: standard deviation of a marker's height against that of the one before."""
_SAME_ANGLE_RAD = math.radians(0.5)
_STARTS = 12
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
"""Ratio of the costs of both sides: markers far from their described places count as well."""
_NOISY_MM = 0.12
"""A residual above this is no noise of a usual camera."""
_NOTABLE_MM = 1.0
"""Hysteresis that is named with it."""


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
    """Weight beyond segment 1 x length / bending stiffness, against z of (10)."""
    hysteresis_mm: Array
    """(2,): see ``Rests.hysteresis_mm``."""
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
    hysteresis_mm = rests.hysteresis_mm()
    _require_coverage(seen)
    length_mm = geometry.segment_lengths_mm[1]
    scale = float(np.mean(np.linalg.norm(seen.along_2[seen.straight_2], axis=1))) / length_mm
    if abs(scale - 1.0) > MAX_SCALE_ERROR:
        raise RegistrationError(
            f"segment 2 measures {scale * length_mm:.1f} mm instead of {length_mm:g}",
            "correct robot.segment_lengths_mm, or check the camera's calibration",
        )
    plane = _fit_plane(seen)
    fit = _fit_shape(seen, plane, geometry, hysteresis_mm)
    result = Registration(
        camera_to_robot=fit.camera_to_robot,
        uncertainty_deg=np.degrees([fit.turn_sigma_rad, *_tilt_sigma_rad(plane, fit)]),
        residual_mm=math.hypot(plane.residual_mm, fit.residual_mm),
        scale=scale,
        segment_1_mm=geometry.segment_lengths_mm[0] + fit.unknowns.longer_mm,
        load=fit.unknowns.load,
        hysteresis_mm=hysteresis_mm,
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
    """(K,): motor 2 is at its most frequent angle; bent, segment 2 would load the arc otherwise."""
    ways_1: Array
    """(K,): sign of the last motion of motor 1; 0 before it moved."""

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
            q_rad,
            markers[:, 1] - markers[:, 0],
            markers[:, 2] - markers[:, 1],
            most_frequent,
            rests.ways()[:, 0],
        )


@dataclass(frozen=True, eq=False)
class _Plane:
    """The plane in which segment 1 bends; its normal is x of (10) up to the sign."""

    normal: Array
    scatter: Array
    """(3, 3): sum of squares of the distances from it is n' scatter n, mm^2."""
    residual_mm: float


@dataclass(frozen=True, eq=False)
class _Shape:
    camera_to_robot: Array
    bending_rad: Array
    """(K,): of segment 1, of the poses in which segment 2 is straight."""
    unknowns: _Unknowns
    residual_mm: float
    cost: float
    turn_sigma_rad: float


class _Unknowns(NamedTuple):
    """What the shapes of segment 1 are fitted with; see ``UnevenArc``."""

    turn: float
    """Direction of the base's tangent in the plane, rad."""
    load: float
    load_along: float
    taper: float
    friction: float
    sag: float
    shortening: float
    """Share of L_1 lost to a tendon whose moment bends segment 1 by 1 rad."""
    longer_mm: float
    """L_1 above its description; then the height of M2 above M1, and of M3 above M2."""
    higher_2_mm: float
    higher_3_mm: float


def _prior(gravity_direction: Sequence[float]) -> tuple[_Unknowns, _Unknowns]:
    """Means and standard deviations of the unknowns.

    Loads: the paper's robot has about 0.3; its base stands within 6 deg of the described direction.
    Taper: up to 0.13 measured on prints. Friction: 0.22 to 0.26 measured on printed disks. Sag: 6
    flexures have 0.045 (docs/control-statics.md), a continuous backbone 0. Shortening: 0.01 is a
    tendon of 4 N per rad on a backbone of 7 kN/m.
    """
    along, against = -gravity_direction[1], -gravity_direction[2]
    mean = _Unknowns(0.0, 0.35 * against, 0.35 * along, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.0)
    return mean, _Unknowns(
        turn=1e3,
        load=math.hypot(0.1, against),
        load_along=math.hypot(0.1, along),
        taper=0.2,
        friction=0.3,
        sag=0.03,
        shortening=0.01,
        longer_mm=_LENGTH_TOLERANCE_MM,
        higher_2_mm=_HEIGHT_TOLERANCE_MM,
        higher_3_mm=_HEIGHT_TOLERANCE_MM,
    )


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
    if np.ptp(seen.q_rad[:, 1]) < 2 * _SAME_ANGLE_RAD:
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
    return _Plane(normal, scatter, float(np.std(places @ normal)))


def _tilt_sigma_rad(plane: _Plane, fit: _Shape) -> tuple[float, float]:
    """Standard deviations about y and z of (10), which tilt x."""
    sigma_mm = max(_SHAPE_ERROR_MM, plane.residual_mm)
    axes = fit.camera_to_robot[1:]
    # Turning about y moves x along z, and the other way round.
    covariance = np.linalg.inv(axes @ plane.scatter @ axes.T) * sigma_mm**2
    return math.sqrt(covariance[1, 1]), math.sqrt(covariance[0, 0])


def _fit_shape(seen: _Vectors, plane: _Plane, geometry: Robot, hysteresis_mm: Array) -> _Shape:
    """Fit the base tangent for both choices of +x; the side on which the markers stand decides."""
    one, other = (_fit_sided(seen, side * plane.normal, geometry) for side in (1.0, -1.0))
    better, worse = sorted((one, other), key=lambda fit: fit.cost)
    if better.residual_mm > MAX_RESIDUAL_MM:
        raise _misfit(better.residual_mm, hysteresis_mm)
    if worse.cost < _MIN_MIRROR_RATIO * better.cost:
        raise RegistrationError(
            "the markers do not tell up from down: the shapes fit markers on either side of the "
            "backbone",
            "mount all markers on the same side, further from the backbone, and correct "
            "robot.marker_offset_mm",
        )
    return better


def _misfit(residual_mm: float, hysteresis_mm: Array) -> RegistrationError:
    worst_mm = float(np.nanmax(np.append(hysteresis_mm, 0.0)))
    told = f"M2 is {residual_mm:.2f} mm (RMS) off it, too much to tell how the camera is turned"
    if worst_mm < _NOTABLE_MM:
        return RegistrationError(
            f"segment 1 has a shape that no load, taper or friction explains: {told}",
            "check that markers and base sit firmly, that nothing touches the robot, and "
            "robot.marker_offset_mm",
        )
    return RegistrationError(
        f"segment 1 does not repeat its shape: {told}; approached from both sides, M3 stops "
        f"{2 * worst_mm:.1f} mm apart",
        "look for a tendon that rubs or slips, a loose horn or pulley, or a cracked flexure",
    )


def _fit_sided(seen: _Vectors, normal: Array, geometry: Robot) -> _Shape:
    across = np.linalg.svd(normal[None])[2][1]
    upwards = np.cross(across, normal)
    # Right-handed with x = normal, y = -across, z = upwards; s = -f[1] + i f[2] as in kinematics.
    first, second = seen.along_1[seen.straight_2], seen.along_2[seen.straight_2]
    to_marker_2: ComplexArray = first @ across + 1j * (first @ upwards)
    seen_rad = np.angle(second @ across + 1j * (second @ upwards))
    ways = seen.ways_1[seen.straight_2]
    length_mm, length_2_mm = geometry.segment_lengths_mm
    offset_mm = geometry.marker_offset_mm
    hinged = 2.0 / 3.0 * geometry.tendon_radius_mm / length_mm

    mean, deviation = (np.array(part) for part in _prior(geometry.gravity_direction))

    def bending_rad(at: _Unknowns) -> Array:
        tangent_rad = seen_rad - at.higher_3_mm / length_2_mm - at.turn
        return np.asarray(np.angle(np.exp(1j * tangent_rad)), dtype=np.float64)

    def residuals(unknowns: Array) -> Array:
        at = _Unknowns(*unknowns)
        bending = bending_rad(at)
        arc = UnevenArc(complex(at.load_along, at.load), at.taper, at.friction * ways, at.sag)
        unit, moment = chord(bending, arc)
        short = at.shortening * np.abs(moment) + hinged * at.sag * bending**2
        shape = (
            (length_mm * (1.0 - short) + at.longer_mm) * unit
            + 1j * (offset_mm + at.higher_2_mm) * np.exp(1j * bending)
            - 1j * offset_mm
        )
        misfit = (to_marker_2 - np.exp(1j * at.turn) * shape) / _SHAPE_ERROR_MM
        return np.concatenate([misfit.real, misfit.imag, (unknowns - mean) / deviation])

    starts = np.linspace(-math.pi, math.pi, _STARTS, endpoint=False)
    guesses = [np.array([turn, *mean[1:]]) for turn in starts]
    guess = min(guesses, key=lambda at: float(np.sum(residuals(at) ** 2)))
    best = least_squares(residuals, guess, method="lm")
    found = _Unknowns(*best.x)
    misfit_mm = best.fun[: 2 * len(ways)] * _SHAPE_ERROR_MM
    residual_mm = float(np.sqrt(np.mean(misfit_mm**2)))
    # Row norms of the pseudo-inverse: variances that rounding cannot make negative.
    sigma = np.linalg.norm(np.linalg.pinv(best.jac, rcond=0.0), axis=1)
    sigma *= max(1.0, residual_mm / _SHAPE_ERROR_MM)
    base_tangent = math.cos(found.turn) * across + math.sin(found.turn) * upwards
    return _Shape(
        camera_to_robot=np.stack([normal, -base_tangent, np.cross(normal, -base_tangent)]),
        bending_rad=bending_rad(found),
        unknowns=found,
        residual_mm=residual_mm,
        cost=float(best.fun @ best.fun),
        turn_sigma_rad=math.hypot(sigma[0], _ARC_ERROR_RAD),
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
    lifting = float(np.polyfit(seen.q_rad[seen.straight_2, 0], fit.bending_rad, 1)[0])
    return tuple(motor for motor, way in ((1, lifting), (2, moved_mm)) if way < 0)


def _require_quality(result: Registration, geometry: Robot) -> None:
    length_mm = geometry.segment_lengths_mm[0]
    if abs(result.segment_1_mm - length_mm) > MAX_SEGMENT_ERROR_MM:
        raise RegistrationError(
            f"segment 1 measures {result.segment_1_mm:.1f} mm instead of {length_mm:g}",
            "correct robot.segment_lengths_mm and robot.marker_offset_mm",
        )
    worst_deg = float(np.max(result.uncertainty_deg))
    if not worst_deg <= MAX_UNCERTAINTY_DEG:
        if result.residual_mm > _NOISY_MM:
            raise _misfit(result.residual_mm, result.hysteresis_mm)
        raise RegistrationError(
            f"the rotation is uncertain by {worst_deg:.1f} deg, {MAX_UNCERTAINTY_DEG} are allowed",
            "widen servo.angle_min_deg and angle_max_deg so that the robot can swing further",
        )
