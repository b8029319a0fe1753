"""The tour of rests of controller `adaptive`, slowly: what calibration is fitted to."""

from __future__ import annotations

import numpy as np

from ccr_host.config import Description
from ccr_host.control.adaptive.identification import Rests, Scaling
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.control.adaptive.tour_stops import tour_stops_rad
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tracking.marker_check import MarkerCheck


def measure_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Arm, visit the rests of the controller's own tour, averaging at each, disarm.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        TrackerError: the markers are not those of the robot, or exchanged.
    """
    prior = Scaling(description.robot).parameters(np.zeros(COUNT))
    stops_rad = tour_stops_rad(prior, MotorLimits.of(description.servo))
    tour = visit(rig, MarkerCheck(description), stops_rad, on_pose)
    poses = tour.poses
    return Rests(
        start_rad=tour.start_rad,
        setpoint_rad=np.array([pose.q_rad for pose in poses]).reshape(-1, 2),
        markers_mm=np.array([pose.markers_mm[1:] - pose.markers_mm[0] for pose in poses]).reshape(
            -1, 2, 3
        ),
        count=np.array([pose.count for pose in poses], dtype=np.float64),
    )
