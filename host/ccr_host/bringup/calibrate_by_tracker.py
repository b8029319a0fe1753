"""``ccr-host calibrate``: a tour of rest poses under the tracker, and what it tells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ccr_host.bringup.servo_fit import ServoFit, fit_servos
from ccr_host.config import Description, Servo
from ccr_host.control.adaptive.excitation import tour_bending_rad
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import RestMotion
from ccr_host.run.rig import Rig

OnPose = Callable[[int, int], None]
"""Number of poses done, and of all."""


def calibrate_by_tracker(rig: Rig, description: Description, on_pose: OnPose) -> ServoFit:
    """Arm, visit the poses of the tour that the limits allow, disarm, fit.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        CalibrationError: the poses give no calibration that could be trusted.
    """
    robot = description.robot
    gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    stops = MotorLimits.of(description.servo).clip(tour_bending_rad() / gain)
    motion = RestMotion(rig)
    rig.client.arm()
    motion.start()
    poses = []
    for done, stop in enumerate(stops):
        on_pose(done, len(stops))
        motion.move_to(stop)
        pose = motion.measure_at_rest()
        if pose is not None:
            poses.append(pose)
    motion.move_to(np.zeros(2))
    rig.client.disarm()
    on_pose(len(stops), len(stops))
    return fit_servos(poses, robot)


def corrected(servo: Servo, fit: ServoFit) -> Servo:
    """The servos with neutral pulse and direction as found; scale and limits as before."""
    per_90_us = np.array(servo.pulse_per_90_deg_us)
    neutral_us = np.array(servo.neutral_pulse_us) + per_90_us * fit.neutral_rad / np.radians(90.0)
    return servo.model_copy(
        update={
            "neutral_pulse_us": tuple((np.round(2.0 * neutral_us) / 2.0).tolist()),
            "pulse_per_90_deg_us": tuple((per_90_us * fit.direction).tolist()),
        }
    )
