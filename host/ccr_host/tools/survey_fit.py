"""Fits camera, servos and tendons of a new robot to the rests of one tour.

It is the static model of controller `adaptive` with wide priors for the camera's turn and the
zeros of the servos. That fit needs a frame and directions to start from: under each hypothesis on
the motors and for some zeros, the rests are turned onto those that the prior predicts, and the
nearest ones are fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import Fit, Predict, StaticsFit
from ccr_host.control.adaptive.misfit import (
    driven,
    is_misfit,
    misfit,
    other_mountings,
    wrongly_mounted,
)
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.parameters import COUNT, TURNS, ZEROS, Parameters, Scaling
from ccr_host.control.adaptive.statics import zeros_rad
from ccr_host.control.adaptive.tip import turned_back_mm
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.rests import Rests

Array = NDArray[np.float64]

_TURN_RAD = 0.3
"""Standard deviation of the camera's turn about the frame that the fit starts from."""
_ZERO_RAD = math.radians(30.0)
_ZEROS_1_RAD = np.radians((-12.0, -6.0, 0.0, 6.0, 12.0))
_ZEROS_2_RAD = np.radians((-10.0, -5.0, 0.0, 5.0, 10.0))
"""Zeros from which the fit may start. Friction distorts the cost, so that a single start can end in
a local minimum, most of all along the zero of motor 1, which looks like a turn about x."""
_STARTS = 3
_SHAFT_FACTOR = 1.5
"""By which an unexplained shaft angle is larger than in `adaptive`: zeros and directions that are
not yet calibrated move the robot further."""
_INFLATION = 2.0
"""Factor of the variances that the rests leave, as errors of the model are alike in neighbouring
rests. It and the shaft's factor were chosen on 40 random robots (bench/results.md has others)."""
MAX_TURN_DEG = 3.0
MAX_ZERO_DEG = 2.0
"""A survey that states larger standard deviations is refused."""
_AGREEMENT_RAD = math.radians(0.5)
"""Zeros that are off by less, or by less than their deviation, are not worth a correction."""
_FEWEST_RESTS = 12
_MAX_BASE_MOTION_MM = 1.0
_MIN_SWING_DEG = 30.0
"""Least change of M2's direction; below it sag and rotation cannot be told apart."""
_MIN_SIDEWAYS_MM = 5.0
_NOTABLE_MM = 5.0
"""Width of the hysteresis from which it is named as a cause; `default` has 3 mm."""
_DISTINCT = 1.03
"""Least ratio of the distances from the predictions of two hypotheses on the motors; 1.08 and more
on robots with one thing wrong, 1.001 with markers on the backbone of a robot without weight."""
_MOUNTED_OTHERWISE = 150.0
"""Least difference of minus twice the log likelihood by which another direction of gravity is more
likely than the described one; robots mounted as described had at most 106."""
_RESTS_FOR_CAUSE = 20
"""Those of the controller's tour, which come last; each hypothesis is fitted to them."""


class SurveyError(CcrError):
    """The rests do not determine camera and servos reliably (exit status 3)."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What one tour of rests tells; arrays are (2,), one entry per motor, unless stated."""

    rests: Rests
    """In the robot's frame, with the angles commanded under the present calibration."""
    camera_to_robot: Array
    """(3, 3): turns vectors of the camera's frame into that of (10)."""
    uncertainty_deg: Array
    """(3,): standard deviation about x, y and z of (10)."""
    lengths_mm: Array
    """Lengths of the segments as fitted."""
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
    def hysteresis_mm(self) -> Array:
        """See ``Rests.hysteresis_mm``."""
        return self.rests.hysteresis_mm()

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

    Args:
        rests: rests of the tour, in any frame.
        description: geometry of the robot and noise of the camera. Its servos' directions and zeros
            may be wrong; its registration is not used.

    Raises:
        SurveyError: the rests do not determine the robot reliably; the message says why.
        MisfitError: no such robot explains the rests; the message names the likely cause.
    """
    _require_motion(rests)
    predict = make_model(description.control).predicted_mm
    scaling = Scaling(description.robot, _TURN_RAD, _ZERO_RAD, description.tracker.noise_mm)
    scaling.shaft_rad *= _SHAFT_FACTOR
    starts = _nearest_starts(rests, scaling, predict)
    fits = [_fitted(start, rests, scaling, predict) for start in starts]
    start, fit = min(zip(starts, fits, strict=True), key=lambda pair: pair[1].cost)
    swapped, *signs = start.motors
    as_mounted = driven(rests, signs)
    if swapped or is_misfit(fit, as_mounted, scaling, zeros_are_known=False):
        raise misfit(as_mounted.last(_RESTS_FOR_CAUSE), description, scaling)
    gravity, cost = _mounted_otherwise(description.robot, start.motors, rests, scaling, predict)
    if cost < fit.cost - _MOUNTED_OTHERWISE:
        raise wrongly_mounted(gravity)
    p = scaling.parameters(fit.score)
    turn_back = np.array([turned_back_mm(p, axis) for axis in np.eye(3)]).T
    deviation = scaling.deviation * np.sqrt(np.diag(_inflated(fit)))
    camera_to_robot, direction = turn_back @ start.to_frame, np.array(signs)
    found = Survey(
        rests=rests.turned(camera_to_robot),
        camera_to_robot=camera_to_robot,
        uncertainty_deg=np.degrees(deviation[TURNS]),
        lengths_mm=np.array([p.length_1_mm, p.length_2_mm]),
        direction=direction,
        neutral_rad=direction * zeros_rad(p),
        neutral_deviation_rad=deviation[ZEROS],
        take_up_rad=np.array([p.slack_1_rad, p.slack_2_rad]),
        gain=np.array([p.gain_1, p.gain_2]),
        fit=fit,
    )
    _require_certainty(found)
    return found


class _Motors(NamedTuple):
    """A hypothesis on the motors; 1 or -1 for each."""

    swapped: bool
    sign_1: float
    sign_2: float

    def drive(self, rests: Rests) -> Rests:
        """The rests with the angles that the described motors would have got."""
        return driven(rests, (self.sign_1, self.sign_2), swapped=self.swapped)


class _Start(NamedTuple):
    """Where a fit starts."""

    off_mm: float
    """Root of the sum of squared distances between the turned markers and the prediction."""
    motors: _Motors
    to_frame: Array
    """(3, 3): from the camera's frame to one near the robot's."""
    score: Array


_OFF_MM = attrgetter("off_mm")


def _starts(
    motors: _Motors, rests: Rests, scaling: Scaling, predict: Predict[Parameters]
) -> list[_Start]:
    """The nearest start for each zero of motor 1."""
    scores = np.zeros((len(_ZEROS_1_RAD), len(_ZEROS_2_RAD), COUNT))
    scores[..., ZEROS[0]] = _ZEROS_1_RAD[:, None] / scaling.deviation[ZEROS[0]]
    scores[..., ZEROS[1]] = _ZEROS_2_RAD / scaling.deviation[ZEROS[1]]
    seen_mm = rests.vectors_mm.reshape(-1, 3)
    expected_mm = predict(scaling.each(scores.reshape(-1, COUNT)), motors.drive(rests))
    expected_mm = np.moveaxis(expected_mm, 0, 1).reshape(*scores.shape[:2], -1, 3)
    return [
        min((_start(motors, *at, seen_mm) for at in zip(*row, strict=True)), key=_OFF_MM)
        for row in zip(expected_mm, scores, strict=True)
    ]


def _start(motors: _Motors, expected_mm: Array, score: Array, seen_mm: Array) -> _Start:
    turn, off_mm = Rotation.align_vectors(expected_mm, seen_mm)
    return _Start(float(off_mm), motors, turn.as_matrix(), score)


def _nearest_starts(rests: Rests, scaling: Scaling, predict: Predict[Parameters]) -> list[_Start]:
    """The nearest starts of the hypothesis on the motors that is nearest.

    Raises:
        SurveyError: another hypothesis, whose frame is not the same, is as near.
    """
    supposed = [_Motors(*motors) for motors in product((False, True), (1.0, -1.0), (1.0, -1.0))]
    trials = (_starts(motors, rests, scaling, predict) for motors in supposed)
    best, rival, *_ = sorted(
        (sorted(starts, key=_OFF_MM) for starts in trials), key=lambda starts: starts[0].off_mm
    )
    if rival[0].off_mm < _DISTINCT * best[0].off_mm:
        raise SurveyError(
            "the markers do not tell up from down: the rests fit markers on either side of the "
            "backbone",
            "mount all markers on the same side, further from the backbone, and correct "
            "robot.marker_offset_mm",
        )
    return best[:_STARTS]


def _fitted(start: _Start, rests: Rests, scaling: Scaling, predict: Predict[Parameters]) -> Fit:
    supposed = start.motors.drive(rests).turned(start.to_frame)
    return StaticsFit(scaling, supposed, predict, start.score).finish()


def _mounted_otherwise(
    robot: Robot, motors: _Motors, rests: Rests, scaling: Scaling, predict: Predict[Parameters]
) -> tuple[tuple[float, float, float], float]:
    """The most likely one of other directions of gravity, and the cost of its fit."""
    costs = {}
    for gravity in other_mountings(robot):
        mounted = scaling.mounted(gravity)
        start = min(_starts(motors, rests, mounted, predict), key=_OFF_MM)
        costs[gravity] = _fitted(start, rests, mounted, predict).cost
    return min(costs.items(), key=lambda pair: pair[1])


def _inflated(fit: Fit) -> Array:
    """The covariance of the scores, with what the rests tell counting for less, (COUNT, COUNT)."""
    prior = np.eye(COUNT)
    told = np.linalg.inv(fit.covariance) - prior
    return np.asarray(np.linalg.inv(told / (_INFLATION * max(1.0, fit.surprise**2)) + prior))


def _require_motion(rests: Rests) -> None:
    """Refuse rests from which no fit can tell anything.

    Raises:
        SurveyError: too few rests, the base moved, or a motor moved nothing.
    """
    if len(rests.q_rad) < _FEWEST_RESTS:
        raise SurveyError(
            f"the markers were seen in {len(rests.q_rad)} poses; {_FEWEST_RESTS} are needed",
            "check line of sight and the camera's measurement volume; see ccr-host monitor",
        )
    base_mm = rests.markers_mm[:, 0]
    moved_mm = float(np.linalg.norm(base_mm - np.median(base_mm, axis=0), axis=1).max())
    if moved_mm > _MAX_BASE_MOTION_MM:
        raise SurveyError(
            f"M1 moved by {moved_mm:.1f} mm between poses",
            "fix base and camera, and keep clear of them during the measurement",
        )
    chords_mm = rests.vectors_mm[:, 0]
    along = chords_mm / np.linalg.norm(chords_mm, axis=1)[:, None]
    swing_deg = math.degrees(math.acos(float(np.clip((along @ along.T).min(), -1.0, 1.0))))
    if swing_deg < _MIN_SWING_DEG:
        raise SurveyError(
            f"segment 1 swung by {swing_deg:.0f} deg only, {_MIN_SWING_DEG:.0f} are needed",
            "check servo power and that tendons 1 and 3 are on servo 1; tighten them; "
            "or widen servo.angle_min_deg and angle_max_deg",
        )
    normal = np.linalg.svd(chords_mm - chords_mm.mean(axis=0))[2][2]
    sideways_mm = float(np.ptp((rests.tip_mm - chords_mm) @ normal))
    if sideways_mm < _MIN_SIDEWAYS_MM:
        raise SurveyError(
            f"segment 2 moved M3 by {sideways_mm:.1f} mm only",
            "check that tendons 2 and 4 are on servo 2; tighten them; "
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
