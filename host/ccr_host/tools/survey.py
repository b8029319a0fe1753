"""One tour for everything that a camera can measure on a new robot.

The camera's orientation follows from the shapes alone, independent of the servos' zeros and
directions. Those follow from the same rests, once rotated into the robot frame. The rests
themselves are the starting point of controller `adaptive`.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tomlkit.items import Array

from ccr_host.control.adaptive.identification import (
    Fit,
    digest_of,
    fits_to,
    likeliest,
    tour_stops_rad,
)
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.description.file import file_to_keep_in, keep_in
from ccr_host.description.schema import Description, Servo
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tools.register import safe_poses_rad
from ccr_host.tools.servo_fit import ServoFit, fit_servos
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.registration import Registration, register

IDENTIFIED = "identified"
_ANGLE_DECIMALS, _LENGTH_DECIMALS = 6, 4


def trial_fit(rests: Rests, description: Description) -> Fit:
    """Fit the model as the controller will, to check that the rests are suitable.

    Raises:
        TrackerError: the rests do not fit the described robot at all.
    """
    fits = fits_to(Scaling.of(description), rests)
    if fits is None:
        raise TrackerError(
            f"the {len(rests.count)} rests measured do not fit the described robot",
            "check the markers with ccr-host monitor, and segment lengths and pulleys in [robot]",
        )
    return likeliest(fits).result()


def identified_section(
    rests: Rests, description: Description, date: datetime.date
) -> dict[str, Any]:
    """The keys of ``[identified]``, rounded below the resolution of board and camera."""
    return {
        "start_rad": rests.start_rad.round(_ANGLE_DECIMALS).tolist(),
        "setpoint_rad": _rows(rests.q_rad.round(_ANGLE_DECIMALS).tolist()),
        "tip_mm": _rows(rests.tip_mm.round(_LENGTH_DECIMALS).tolist()),
        "middle_mm": _rows(rests.vectors_mm[:, 0].round(_LENGTH_DECIMALS).tolist()),
        "count": [int(count) for count in rests.count],
        "valid_for": digest_of(description),
        "date": date,
    }


def _rows(rows: list[list[float]]) -> Array:
    array = tomlkit.array()
    array.extend(rows)
    return array.multiline(True)


_KEYS = ("neutral_pulse_us", "pulse_per_90_deg_us", "angle_min_deg", "angle_max_deg")


def file_for_calibration(robot: str | None, out: Path | None) -> Path:
    """File for a calibration; call it before the measurement.

    Args:
        robot: as given with ``--robot``.
        out: as given with ``--out``.

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
    return {key: list(getattr(servo, key)) for key in _KEYS}


def keep_calibration(
    client: Client, description: Description, servo: Servo, file: Path, robot: str | None
) -> None:
    """Configure the board, save in its EEPROM, then rewrite the description.

    Args:
        client: client of the board.
        description: present description; only its servos are replaced.
        servo: calibrated servos.
        file: as returned by `file_for_calibration`.
        robot: as given with ``--robot``.

    Raises:
        ConfigError: the values are out of the board's range, or the file cannot be written.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    client.configure(board_config(description.model_copy(update={"servo": servo})))
    client.save_config()
    keep_in(file, {"servo": calibrated_section(servo)}, robot)


def measure_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Arm, visit the rests of the controller's tour and average at each, disarm.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        TrackerError: the markers are not those of the robot, or are swapped.
    """
    check = MarkerCheck(description)
    return visit(rig, check, identification_stops_rad(description), on_pose)


def identification_stops_rad(description: Description) -> NDArray[np.float64]:
    """Motor angles of the controller's tour, rad, (N, 2)."""
    prior = Scaling(description.robot).parameters(np.zeros(COUNT))
    return tour_stops_rad(prior, MotorLimits.of(description.servo))


def calibrate_by_tracker(rig: Rig, description: Description, on_pose: OnPose) -> ServoFit:
    """Arm, visit the poses of the tour that the limits allow, disarm, fit.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        CalibrationError: the poses do not determine the calibration reliably.
    """
    rests = measure_rests(rig, description, on_pose)
    return fit_servos(rests, description, registered=description.registration is not None)


def corrected(servo: Servo, fit: ServoFit) -> Servo:
    """The servos with fitted neutral pulse and direction; scale and limits unchanged."""
    per_90_us = np.array(servo.pulse_per_90_deg_us)
    neutral_us = np.array(servo.neutral_pulse_us) + per_90_us * fit.neutral_rad / np.radians(90.0)
    return servo.model_copy(
        update={
            "neutral_pulse_us": tuple((np.round(2.0 * neutral_us) / 2.0).tolist()),
            "pulse_per_90_deg_us": tuple((per_90_us * fit.direction).tolist()),
        }
    )


_AGREEMENT_RAD = np.radians(0.5)
"""Remaining error of a corrected zero: about the accuracy of a tour for motor 1."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Results of one tour."""

    registration: Registration
    servos: ServoFit
    rests: Rests
    """Rests in the robot frame."""

    @property
    def servos_are_as_described(self) -> bool:
        """Whether the described servos need no correction."""
        return bool(
            np.all(self.servos.direction > 0.0)
            and np.all(np.abs(self.servos.neutral_rad) < _AGREEMENT_RAD)
        )


def survey(rig: Rig, description: Description, on_pose: OnPose) -> Survey:
    """Arm, visit the poses of registration and identification, disarm, fit.

    Args:
        rig: rig with samples in the camera frame.
        description: description of the robot; directions and zeros of its servos may be wrong.
        on_pose: called for each pose.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers are not those of the robot, or are swapped.
        RegistrationError: the robot does not rest, or its shapes do not determine the rotation.
        CalibrationError: the rests do not determine the servos' mounting reliably.
    """
    safe_rad = safe_poses_rad(MotorLimits.of(description.servo))
    stops_rad = np.concatenate([safe_rad, identification_stops_rad(description)])
    check = MarkerCheck(description, in_robot_frame=False)
    seen = visit(rig, check, stops_rad, on_pose)
    registration = register(seen, description.robot)
    rests = seen.turned(registration.camera_to_robot)
    return Survey(registration, fit_servos(rests, description, registered=True), rests)
