"""The tour of rests of controller `adaptive`, slowly: what calibration is fitted to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Description
from ccr_host.control.adaptive.identification import Rests, Scaling
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.control.adaptive.tour_stops import tour_stops_rad
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, RestTour, visit
from ccr_host.run.rig import Rig
from ccr_host.tracking.marker_check import MarkerCheck


def measure_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Arm, visit the rests of the controller's own tour, averaging at each, disarm.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
        TrackerError: the markers are not those of the robot, or exchanged.
    """
    check = MarkerCheck(description)
    return rests_of(visit(rig, check, identification_stops_rad(description), on_pose), np.eye(3))


def identification_stops_rad(description: Description) -> NDArray[np.float64]:
    """Motor angles of the controller's own tour, (N, 2)."""
    prior = Scaling(description.robot).parameters(np.zeros(COUNT))
    return tour_stops_rad(prior, MotorLimits.of(description.servo))


def rests_of(tour: RestTour, to_robot: NDArray[np.float64]) -> Rests:
    """A tour as the controller's model sees it.

    Args:
        tour: as measured.
        to_robot: (3, 3), turns vectors of the tour's frame into that of (10).
    """
    poses = tour.poses
    markers_mm = np.array([pose.markers_mm[1:] - pose.markers_mm[0] for pose in poses])
    return Rests(
        start_rad=tour.start_rad,
        setpoint_rad=np.array([pose.q_rad for pose in poses]).reshape(-1, 2),
        markers_mm=markers_mm.reshape(-1, 2, 3) @ to_robot.T,
        count=np.array([pose.count for pose in poses], dtype=np.float64),
    )
