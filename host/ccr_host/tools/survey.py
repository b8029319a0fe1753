"""One tour for everything that a camera can measure on a new robot.

Camera, servos and tendons follow from one fit to its rests (``survey_fit.py``), and the rests
themselves are the starting point of controller `adaptive`.
"""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit import items

from ccr_host.control.adaptive.identification import (
    Fit,
    identification_of,
)
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.description.file import file_to_keep_in, keep_in
from ccr_host.description.schema import Description, Registration, Servo
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.robot.rests import Rests, digest_of
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tools.survey_fit import Survey, fit_survey, require_motion_so_far
from ccr_host.tools.survey_starts import (
    guessed_directions,
    likeliest_motors,
    require_pull,
    safe_poses_rad,
)
from ccr_host.tracking.markers.check import MarkerCheck

REGISTRATION, IDENTIFIED = "registration", "identified"
"""Sections of the robot description."""
_ANGLE_DECIMALS, _LENGTH_DECIMALS, _TIME_DECIMALS = 6, 4, 2
_SERVO_KEYS = ("neutral_pulse_us", "pulse_per_90_deg_us", "angle_min_deg", "angle_max_deg")

_TOUR_SHARE, _TOUR_SHARE_OF_ONE = 0.5, 1.25
"""Part of the controller's tour that another robot of several segments makes: markers at its
extremes cannot be told apart with certainty before the camera is registered. One segment goes
further, as only a wide bend tells its zero from the camera's turn."""
_LED = 3
"""Times that the small moves are made at most, each in the directions found before."""


def identification_stops_rad(description: Description) -> Array:
    """Motor angles of the controller's tour, rad, (N, n)."""
    model, space = make_static_model(description)
    prior = space.parameters(np.zeros(space.count))
    return model.tour_rad(prior, MotorLimits.of(description.servo))


def survey(rig: Rig, description: Description, on_pose: OnPose) -> Survey:
    """Arm, visit poses from both sides and those of the controller's tour, disarm, fit.

    The rig's samples are in any frame; directions and zeros of the servos may be wrong.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers are not those of the robot, or are swapped.
        RestError: the robot does not come to rest.
        SurveyError: the rests do not determine camera and servos reliably.
        MisfitError: the robot is not the described one.
    """
    return fit_survey(survey_rests(rig, description, on_pose), description)


def survey_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """The rests to which `survey` fits.

    The large poses of a robot whose motors may wind tendons against each other are led by what its
    motors did in the small ones. Reversed motors make these pull as well, so that they are made
    again, in the directions found, until these stay the same.

    Raises:
        DeviceError, TrackerError, RestError, SurveyError, MisfitError: as `survey`.
    """
    safe_rad, tour_rad = safe_poses_rad(description), identification_stops_rad(description)
    check = MarkerCheck(description, in_robot_frame=False)

    def judge(done: int, rests: Rests) -> None:
        require_motion_so_far(rests, description, done, safe_rad)

    if not description.robot.segments:  # Its motors cannot pull against each other.
        return visit(rig, check, np.concatenate([safe_rad, tour_rad]), on_pose, judge=judge)

    def telling(before: int, poses: int) -> OnPose:
        return lambda done, _: on_pose(before + done, before + poses)

    to_come = len(safe_rad) + len(tour_rad)
    may_hinder = bool((np.count_nonzero(safe_rad, axis=1) > 1).any())
    directions = np.ones(safe_rad.shape[1])
    for repeat in range(_LED):
        before = repeat * len(safe_rad)
        rests = visit(rig, check, directions * safe_rad, telling(before, to_come), judge=judge)
        if not may_hinder:
            break
        found = guessed_directions(rests, description)
        if np.array_equal(found, directions):
            break
        directions = found
    if may_hinder:
        require_pull(rests, description, directions)
    before += len(safe_rad)
    share = _TOUR_SHARE if len(description.robot.segments) > 1 else _TOUR_SHARE_OF_ONE
    led_rad = share * tour_rad * likeliest_motors(rests, description).signs
    led_rad = MotorLimits.of(description.servo).clip(led_rad)
    later = visit(rig, check, led_rad, telling(before, len(tour_rad)))
    return rests.then(later)


def measure_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Arm, visit the rests of the controller's tour and average at each, disarm.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RestError: the robot does not come to rest.
        TrackerError: the markers are not those of the robot, or are swapped.
    """
    check = MarkerCheck(description)
    model, space = make_static_model(description)
    prior = space.parameters(np.zeros(space.count))
    stops_rad, are_rests = model.tour(prior, MotorLimits.of(description.servo))
    return visit(rig, check, stops_rad, on_pose, are_rests=are_rests)


def trial_fit(rests: Rests, description: Description) -> Fit:
    """Fit the model as the controller will, to check that the rests are suitable.

    Raises:
        TrackerError: the rests do not fit the described robot at all.
    """
    model, space = make_static_model(description)
    found = identification_of(space, rests, model)
    if found is None:
        raise TrackerError(
            f"the {len(rests.count)} rests measured do not fit the described robot",
            "check the markers with ccr-host monitor, and segment lengths and pulleys in [robot]",
        )
    return found.finish().result()


def registration_section(
    found: Survey, description: Description, date: datetime.date
) -> dict[str, Any]:
    """The keys of ``[registration]``, rounded to their accuracy."""
    scale = float(found.lengths_mm[-1]) / description.robot.segment_lengths_mm[-1]
    return {
        "camera_to_robot_deg": [round(float(v), 4) for v in found.camera_to_robot_deg],
        "uncertainty_deg": [round(float(v), 2) for v in found.uncertainty_deg],
        "residual_mm": round(found.residual_mm, 3),
        "date": date,
        "scale": round(scale, 4),
    }


def identified_section(
    rests: Rests, description: Description, date: datetime.date
) -> dict[str, Any]:
    """The keys of ``[identified]``, rounded below the resolution of board and camera."""
    time_s = (rests.time_s - rests.time_s[0]).round(_TIME_DECIMALS)
    vectors_mm = rests.vectors_mm.round(_LENGTH_DECIMALS)
    middle_mm = vectors_mm[:, :-1].reshape(len(vectors_mm), -1)
    return {
        "start_rad": rests.from_rad[0].round(_ANGLE_DECIMALS).tolist(),
        "from_rad": _rows(rests.from_rad.round(_ANGLE_DECIMALS).tolist()),
        "setpoint_rad": _rows(rests.q_rad.round(_ANGLE_DECIMALS).tolist()),
        "tip_mm": _rows(vectors_mm[:, -1].tolist()),
        **({"middle_mm": _rows(middle_mm.tolist())} if middle_mm.size else {}),
        "count": [int(count) for count in rests.count],
        **({} if np.isnan(time_s).any() else {"time_s": time_s.tolist()}),
        "valid_for": digest_of(description),
        "date": date,
    }


def _rows(rows: list[list[float]]) -> items.Array:
    array = tomlkit.array()
    array.extend(rows)
    return array.multiline(True)


def sections_of(
    found: Survey, description: Description, servo: Servo, date: datetime.date
) -> dict[str, dict[str, Any]]:
    """The camera and the rests, as the controller will see them.

    ``description`` is that of the robot during the tour, ``servo`` are those that it will have.
    """
    registration = registration_section(found, description, date)
    after = description.model_copy(
        update={"servo": servo, "registration": Registration.model_validate(registration)}
    )
    rests = recalibrated(found.rests, description.servo, servo)
    return {REGISTRATION: registration, IDENTIFIED: identified_section(rests, after, date)}


def corrected(servo: Servo, found: Survey) -> Servo:
    """The servos with fitted neutral pulse and direction; scale and limits unchanged."""
    per_90_us = np.array(servo.pulse_per_90_deg_us)
    neutral_us = np.array(servo.neutral_pulse_us) + per_90_us * found.neutral_rad / np.radians(90.0)
    return servo.model_copy(
        update={
            "neutral_pulse_us": tuple((np.round(2.0 * neutral_us) / 2.0).tolist()),
            "pulse_per_90_deg_us": tuple((per_90_us * found.direction).tolist()),
        }
    )


def recalibrated(rests: Rests, before: Servo, after: Servo) -> Rests:
    """The same rests, with the motor angles that their pulses are under another calibration."""
    ratio = np.array(before.pulse_per_90_deg_us) / after.pulse_per_90_deg_us
    moved_us = np.subtract(before.neutral_pulse_us, after.neutral_pulse_us)
    moved_rad = np.radians(90.0) * moved_us / after.pulse_per_90_deg_us
    from_rad, q_rad = (ratio * angles + moved_rad for angles in (rests.from_rad, rests.q_rad))
    return replace(rests, from_rad=from_rad, q_rad=q_rad)


def file_for_calibration(robot: str | None, out: Path | None) -> Path:
    """File for a calibration; call it before the measurement.

    Raises:
        ConfigError: the user gave no file, or it is not writable.
    """
    file = file_to_keep_in(robot, out)
    if file is None:
        raise ConfigError(
            "a calibration belongs to one robot, but no description of yours was given",
            "give --out FILE, or your own description with --robot FILE",
        )
    return file


def calibrated_section(servo: Servo) -> dict[str, Any]:
    """The keys of ``[servo]`` that a calibration determines."""
    return {key: list(getattr(servo, key)) for key in _SERVO_KEYS}


def keep_calibration(
    client: Client,
    description: Description,
    servo: Servo,
    file: Path,
    robot: str | None,
    found: Survey | None = None,
) -> None:
    """Configure the board, save in its EEPROM, then rewrite the description.

    ``found`` is the survey by which the servos were calibrated; its camera and rests are kept as
    well.

    Raises:
        ConfigError: the values are out of the board's range, or the file cannot be written.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    client.configure(board_config(description.model_copy(update={"servo": servo})))
    client.save_config()
    measured = (
        {} if found is None else sections_of(found, description, servo, datetime.date.today())
    )
    keep_in(file, {"servo": calibrated_section(servo), **measured}, robot)
