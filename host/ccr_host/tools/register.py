"""``ccr-host register``: move the robot through safe poses and find the camera's orientation.

The rig's tracker must report markers in the camera frame: open it without a registration.
"""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.registration import Registration, register

Array = NDArray[np.float64]

REGISTRATION = "registration"
"""Section of the robot description."""

_SWING_DEG = 50.0
"""Amplitude of motor 1, as far as the tour of controller `adaptive` goes."""
_SIDEWAYS_DEG = 20.0
"""Amplitude of motor 2."""
_SHARE_OF_LIMITS = 0.6
"""Each motor uses at most this fraction of its range."""
_SWINGS = tuple(third / 3 for third in (0, 1, 2, 3, 2, 1, 0, -1, -2, -3, -2, -1, 0))
"""Poses of motor 1, all but the extremes approached from both sides, as friction bends the robot
otherwise on each."""
_SIDES = (1.0, 0.0, -1.0, 0.0)
"""Poses of motor 2."""


def safe_poses_rad(limits: MotorLimits) -> Array:
    """Motor angles to visit, (K, 2): small, symmetric about the middle of the limits or zero."""
    reach = _SHARE_OF_LIMITS * np.minimum(-limits.lower_rad, limits.upper_rad)
    swing, sideways = np.minimum(np.radians([_SWING_DEG, _SIDEWAYS_DEG]), np.maximum(reach, 0.0))
    return np.array(
        [(share * swing, 0.0) for share in _SWINGS] + [(0.0, share * sideways) for share in _SIDES]
    )


def register_robot(rig: Rig, description: Description, on_pose: OnPose) -> Registration:
    """Arm the robot, visit the poses, disarm, fit and check the result.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: no markers, or not those of this robot.
        RegistrationError: the poses do not determine the rotation reliably.
    """
    return register(collect_rests(rig, description, on_pose), description.robot)


def collect_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Measure the robot at rest in each of the safe poses; those without markers are left out.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: no markers in any pose, or not those of this robot.
        RegistrationError: the robot does not come to rest.
    """
    check = MarkerCheck(description, in_robot_frame=False)
    rests = visit(rig, check, safe_poses_rad(MotorLimits.of(description.servo)), on_pose)
    if not len(rests.q_rad):
        raise TrackerError(
            f"no markers from {rig.tracker.name} in any pose",
            "check line of sight and the camera's measurement volume; see ccr-host monitor",
        )
    return rests


def registration_section(registration: Registration, date: datetime.date) -> dict[str, Any]:
    """The keys of ``[registration]``, rounded to their accuracy."""
    return {
        "camera_to_robot_deg": [round(float(v), 4) for v in registration.camera_to_robot_deg],
        "uncertainty_deg": [round(float(v), 2) for v in registration.uncertainty_deg],
        "residual_mm": round(registration.residual_mm, 3),
        "scale": round(registration.scale, 4),
        "date": date,
    }
