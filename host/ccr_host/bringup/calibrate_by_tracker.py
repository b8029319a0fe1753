"""``ccr-host calibrate``: a tour of rest poses under the tracker, and what it tells."""

from __future__ import annotations

import numpy as np

from ccr_host.bringup.measure_rests import measure_rests
from ccr_host.bringup.servo_fit import ServoFit, fit_servos
from ccr_host.config import Description, Servo
from ccr_host.run.rest_motion import OnPose
from ccr_host.run.rig import Rig


def calibrate_by_tracker(rig: Rig, description: Description, on_pose: OnPose) -> ServoFit:
    """Arm, visit the poses of the tour that the limits allow, disarm, fit.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        CalibrationError: the poses give no calibration that could be trusted.
    """
    rests = measure_rests(rig, description, on_pose)
    return fit_servos(rests, description, registered=description.registration is not None)


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
