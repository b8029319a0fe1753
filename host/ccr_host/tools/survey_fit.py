"""Fits camera, servos and tendons of a new robot to the rests of one tour.

It is the static model of controller `adaptive` with wide priors for the camera's turn and the
zeros of the servos. That fit needs a frame and directions to start from: under each hypothesis on
the motors and for some zeros, the rests are turned onto those that the prior predicts, and the
nearest ones are fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import Fit
from ccr_host.control.adaptive.misfit import (
    BEYOND_SLACK_RAD,
    STILL_MM,
    is_misfit,
    misfit,
    misfit_of,
    wrongly_mounted,
)
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.parameters import Scaling
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Rests
from ccr_host.tools.survey_starts import (
    SurveyError,
    fitted,
    likeliest_motors,
    model_of_new,
    starts_of,
    where_tendons_pull,
)

_STARTS = 3
MAX_TURN_DEG = 3.0
MAX_ZERO_DEG = 2.0
"""A survey that states larger standard deviations is refused."""
_AGREEMENT_RAD = math.radians(0.5)
"""Zeros that are off by less, or by less than their deviation, are not worth a correction."""
_FEWEST_RESTS = 12
_MAX_BASE_MOTION_MM = 1.0
_MIN_MOTION_MM = 5.0
"""Linear motion of the tip that each motor must cause."""
_FIRST_POSES = 5
"""The tour ends if none of these was seen."""
_NOTABLE_MM = 5.0
"""Width of the hysteresis from which it is named as a cause; `default` has 3 mm."""
_MOUNTED_OTHERWISE = 150.0
"""Least difference of minus twice the log likelihood by which another direction of gravity is more
likely than the described one; robots mounted as described had at most 106."""
_MOST_STANDING_OUT = 0.2
"""Share of the rests, at most, that are left out where a segment hangs in its slack and friction
decides where it stays."""
_RESTS_FOR_CAUSE = 20
"""Those of the controller's tour, which come last; each hypothesis is fitted to them."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What one tour of rests tells; arrays are (n,), one entry per motor, unless stated."""

    rests: Rests
    """Those that were fitted, in the robot's frame, with the angles commanded under the present
    calibration."""
    hysteresis_mm: Array
    """See ``Rests.hysteresis_mm``."""
    camera_to_robot: Array
    """(3, 3): turns vectors of the camera's frame into that of (10)."""
    uncertainty_deg: Array
    """(3,): standard deviation about x, y and z of (10)."""
    lengths_mm: Array
    """Lengths of the segments as fitted, (S,)."""
    direction: Array
    """1 if as described, -1 if reversed."""
    neutral_rad: Array
    """Angle under the present calibration at which the shaft is at 0."""
    neutral_deviation_rad: Array
    """Standard deviation of ``neutral_rad``."""
    take_up_rad: Array
    """Motor angle that takes up the slack of a straight segment."""
    gain: Array
    """Bending over motor angle with taut tendons; r_p / r_c in the description."""
    fit: Fit

    @property
    def camera_to_robot_deg(self) -> Array:
        """(3,): the rotation as a rotation vector in degrees."""
        vector: Array = Rotation.from_matrix(self.camera_to_robot).as_rotvec(degrees=True)
        return vector

    @property
    def residual_mm(self) -> float:
        """RMS distance of the markers from the model."""
        return self.fit.rms_mm

    @property
    def servos_are_as_described(self) -> bool:
        """Whether the described servos need no correction."""
        allowed_rad = np.maximum(_AGREEMENT_RAD, self.neutral_deviation_rad)
        return bool(np.all((self.direction > 0.0) & (np.abs(self.neutral_rad) < allowed_rad)))

    @property
    def reversed_motors(self) -> tuple[int, ...]:
        """Numbers of the motors that turn against their description, from 1."""
        return tuple(int(motor) + 1 for motor in np.flatnonzero(self.direction < 0.0))


def fit_survey(rests: Rests, description: Description) -> Survey:
    """Fit the robot and judge the result.

    The rests are in any frame. Directions and zeros of the described servos may be wrong; the
    registration is not used.

    Raises:
        SurveyError: the rests do not determine the robot reliably; the message says why.
        MisfitError: no such robot explains the rests; the message names the likely cause.
    """
    _require_motion(rests, description)
    hysteresis_mm = rests.hysteresis_mm()
    model, space = model_of_new(description)
    predict, motors = model.predicted_mm, likeliest_motors(rests, description)
    if description.robot.segments:
        rests = where_tendons_pull(rests)
    seen = rests
    starts = starts_of(motors, seen, space, predict)[:_STARTS]
    fits = [fitted(start, seen, space, model) for start in starts]
    start, fit = min(zip(starts, fits, strict=True), key=lambda pair: pair[1].cost)
    if description.robot.segments and 0.0 < fit.stands_out.mean() <= _MOST_STANDING_OUT:
        seen = seen.chosen(~fit.stands_out)
        fit = fitted(start._replace(score=fit.score), seen, space, model)
    as_mounted = motors.drive(seen)
    if is_misfit(fit, as_mounted, space, zeros_are_known=False):
        if isinstance(space, Scaling):
            raise misfit(as_mounted.last(_RESTS_FOR_CAUSE), description, space)
        raise misfit_of(fit, space, zeros_are_known=False)
    costs = {
        fitted(starts_of(motors, seen, mounted, predict)[0], seen, mounted, model).cost: gravity
        for gravity, mounted in space.mountings().items()
    }
    if costs and min(costs) < fit.cost - _MOUNTED_OTHERWISE:
        raise wrongly_mounted(costs[min(costs)])
    p = space.parameters(fit.score)
    turn_back = np.array([model.turned_back_mm(p, axis) for axis in np.eye(3)]).T
    covariance = _inflated(fit, space)
    deviation = space.deviation * np.sqrt(np.diag(covariance))
    camera_to_robot, direction = turn_back @ start.to_frame, np.array(motors.signs)
    mounting = space.mounting(fit.score)
    found = Survey(
        rests=rests.turned(camera_to_robot),
        hysteresis_mm=hysteresis_mm,
        camera_to_robot=camera_to_robot,
        uncertainty_deg=np.degrees(deviation[space.roles.turns]),
        lengths_mm=mounting.lengths_mm,
        direction=direction,
        neutral_rad=direction * (space.zero_rad @ fit.score),
        neutral_deviation_rad=space.zeros_deviation_rad(covariance),
        take_up_rad=mounting.take_up_rad,
        gain=mounting.gain,
        fit=fit,
    )
    _require_certainty(found)
    return found


def _inflated(fit: Fit, space: ParameterSpace[Any]) -> Array:
    """The covariance of the scores, with what the rests tell counting for less, (COUNT, COUNT)."""
    prior = np.eye(len(fit.score))
    told = np.linalg.inv(fit.covariance) - prior
    weight = 1.0 / (space.inflation * max(1.0, fit.surprise**2))
    return np.asarray(np.linalg.inv(weight * told + prior))


def _require_motion(rests: Rests, description: Description) -> None:
    """Refuse rests from which no fit can tell anything.

    Raises:
        SurveyError: too few rests, the base moved, or a motor moved nothing.
    """
    _require_rests(rests, _FEWEST_RESTS)
    base_mm = rests.markers_mm[:, 0]
    base_moved_mm = float(np.linalg.norm(base_mm - np.median(base_mm, axis=0), axis=1).max())
    if base_moved_mm > _MAX_BASE_MOTION_MM:
        raise SurveyError(
            f"M1 moved by {base_moved_mm:.1f} mm between poses",
            "fix base and camera, and keep clear of them during the measurement",
        )
    _require_moves(rests, description, np.full(rests.q_rad.shape[1], _MIN_MOTION_MM))


def require_motion_so_far(
    rests: Rests, description: Description, done: int, alone_rad: Array
) -> None:
    """End a tour of which no fit could tell anything.

    ``alone_rad`` are the first poses of the tour, of one motor after the other, with others that
    pay out, (K, n); ``done`` is the number of poses so far.

    Raises:
        SurveyError: the markers were not seen yet, or a motor that was led through its own poses
            moved nothing.
    """
    if done < _FIRST_POSES:
        return
    _require_rests(rests, 1)
    is_led = np.ptp(rests.q_rad, axis=0) > BEYOND_SLACK_RAD
    for motor in np.flatnonzero(is_led & ~alone_rad[done:].any(axis=0)):
        led_with_it = alone_rad[alone_rad[:, motor] != 0.0].any(axis=0)
        alone = rests.chosen(np.count_nonzero(rests.q_rad[:, ~led_with_it], axis=1) == 0)
        _require_moves(alone, description, STILL_MM * np.eye(len(is_led))[motor])


def _require_rests(rests: Rests, fewest: int) -> None:
    if len(rests.q_rad) < fewest:
        raise SurveyError(
            f"the markers were seen in {len(rests.q_rad)} poses; {_FEWEST_RESTS} are needed",
            "check line of sight and the camera's measurement volume; see ccr-host monitor",
        )


def _require_moves(rests: Rests, description: Description, least_mm: Array) -> None:
    """Refuse rests in which a motor moved the tip by less than that, (n,)."""
    tip, moved_mm = description.robot.markers[-1], rests.moved_mm()
    for motor in np.flatnonzero(moved_mm < least_mm):
        raise SurveyError(
            f"motor {motor + 1} moved {tip} by {moved_mm[motor]:.1f} mm only",
            "check its supply, and that its tendons are on its pulley; tighten them; "
            "or widen servo.angle_min_deg and angle_max_deg",
        )


def _require_certainty(found: Survey) -> None:
    """Refuse a survey whose stated deviations are large.

    Raises:
        SurveyError: they are; the message names what they come from.
    """
    turn_deg = float(found.uncertainty_deg.max())
    zero_deg = math.degrees(float(found.neutral_deviation_rad.max()))
    if turn_deg <= MAX_TURN_DEG and zero_deg <= MAX_ZERO_DEG:
        return
    told = (
        f"the camera is uncertain by {turn_deg:.1f} deg, where {MAX_TURN_DEG:g} are allowed, and "
        f"the zeros of the servos by {zero_deg:.1f} deg, where {MAX_ZERO_DEG:g} are"
    )
    if found.fit.surprise <= 1.0:
        raise SurveyError(
            told,
            "widen servo.angle_min_deg and angle_max_deg so that the robot can swing further",
        )
    worst_mm = 2.0 * float(np.nanmax(np.append(found.hysteresis_mm, 0.0)))
    if worst_mm > _NOTABLE_MM:
        raise SurveyError(
            f"the robot does not repeat its poses: approached from both sides, M3 stops "
            f"{worst_mm:.1f} mm apart; {told}",
            "look for a tendon that rubs or slips, a loose horn or pulley, or a cracked flexure",
        )
    raise SurveyError(
        f"{found.fit.residual}; {told}",
        "check that markers and base sit firmly, that nothing touches the robot, and "
        "robot.marker_offset_mm",
    )
