"""One tour for all that a camera can tell of a new robot.

How the camera stands follows from the shapes alone, whatever the servos' zeros and directions.
Those follow from the same rests, once turned into the robot's frame. And the rests themselves are
what controller `adaptive` begins with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ccr_host.bringup.measure_rests import identification_stops_rad, rests_of
from ccr_host.bringup.servo_fit import ServoFit, fit_servos
from ccr_host.config import Description
from ccr_host.control.adaptive.identification import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.register import safe_poses_rad
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tracking.marker_check import MarkerCheck
from ccr_host.tracking.registration import Registration, register

_AGREEMENT_RAD = np.radians(0.5)
"""What is left of a zero that was corrected: about what a tour can tell of motor 1."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What one tour has told."""

    registration: Registration
    servos: ServoFit
    rests: Rests
    """In the robot's frame."""

    @property
    def servos_are_as_described(self) -> bool:
        """Whether there is nothing to correct."""
        return bool(
            np.all(self.servos.direction > 0.0)
            and np.all(np.abs(self.servos.neutral_rad) < _AGREEMENT_RAD)
        )


def survey(rig: Rig, description: Description, on_pose: OnPose) -> Survey:
    """Arm, visit the poses of registration and identification, disarm, fit.

    Args:
        rig: with samples in the camera's own frame.
        description: of the robot; how its servos turn and where they stand need not be right.
        on_pose: is told of the poses.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers are not those of the robot, or exchanged.
        RegistrationError: the robot does not rest, or its shapes tell no rotation.
        CalibrationError: the rests tell nothing certain of the servos.
    """
    safe_rad = safe_poses_rad(MotorLimits.of(description.servo))
    stops_rad = np.concatenate([safe_rad, identification_stops_rad(description)])
    check = MarkerCheck(description, in_robot_frame=False)
    tour = visit(rig, check, stops_rad, on_pose)
    registration = register(tour.poses, description.robot)
    rests = rests_of(tour, registration.camera_to_robot)
    return Survey(registration, fit_servos(rests, description, registered=True), rests)
