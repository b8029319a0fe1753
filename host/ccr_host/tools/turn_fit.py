"""Measures how the camera stands to a robot described by ``[[robot.segments]]``.

Each motor moves to either side, then all move together. The model of rests of `identify` is fitted
to all markers: lengths, radii, slack, stretch, weight and the camera's turn, each with its prior. A
robot that hangs gives the turn within its stated deviation; sag across the backbone, which is not
of constant curvature, is mistaken for a tilt of some degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.misfit import MisfitError
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.rest_model import Markers
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.response_check import MotorResponses
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tools.chain_fit import ChainModel, fit_chain
from ccr_host.tracking.markers.check import MarkerCheck

Array = NDArray[np.float64]

_REACH_RAD = math.radians(30.0)
_SHARE_OF_LIMITS = 0.6
"""Each motor uses at most this fraction of its range."""
_TOGETHER = 12
_MAX_UNCERTAINTY_DEG = 3.0
_MOST_LEFT = 0.25
"""Share of the markers' motion that the model may leave unexplained, as in `identify`."""


class TurnError(CcrError):
    """The rests do not determine how the camera stands (exit status 3)."""


@dataclass(frozen=True, eq=False)
class CameraTurn:
    """How the camera stands."""

    camera_to_robot: Array
    """(3, 3): turns vectors of the camera's frame into that of (10)."""
    uncertainty_deg: Array
    """(3,): standard deviation about x, y and z of (10)."""
    residual_mm: float
    """RMS distance of the markers from the model."""

    @property
    def camera_to_robot_deg(self) -> Array:
        """(3,): the rotation as a rotation vector in degrees."""
        vector: Array = Rotation.from_matrix(self.camera_to_robot).as_rotvec(degrees=True)
        return vector


def turn_stops_rad(limits: MotorLimits) -> Array:
    """Motor angles to visit, (K, n): the middle, each motor alone, then all at random ones."""
    reach = _SHARE_OF_LIMITS * np.minimum(-limits.lower_rad, limits.upper_rad)
    reach_rad = np.minimum(np.maximum(reach, 0.0), _REACH_RAD)
    alone = np.diag(reach_rad)
    sides = np.stack([alone, -alone], axis=1).reshape(-1, len(reach_rad))
    # The same for every robot of as many motors.
    shares = np.random.default_rng(0).uniform(-1.0, 1.0, (_TOGETHER, len(reach_rad)))
    return np.vstack([np.zeros_like(reach_rad), sides, shares * reach_rad])


def measure_turn(rig: Rig, description: Description, on_pose: OnPose) -> CameraTurn:
    """Arm, visit the stops, disarm, fit.

    Args:
        rig: rig with samples in the camera's frame.
        description: of the robot; its registration is not used.
        on_pose: called for each stop.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers are not those of the robot, or are swapped.
        RestError: the robot does not come to rest.
        TurnError: the rests do not determine the turn.
        MisfitError: motors are reversed or exchanged.
    """
    stops_rad = turn_stops_rad(MotorLimits.of(description.servo))
    check = MarkerCheck(description, in_robot_frame=False)
    return fit_turn(visit(rig, check, stops_rad, on_pose), description)


def fit_turn(rests: Rests, description: Description) -> CameraTurn:
    """Fit the turn to rests at `turn_stops_rad`, in the order of the tour.

    Raises:
        TurnError, MisfitError: as `measure_turn`.
    """
    robot = description.robot
    if len(rests.q_rad) <= robot.motors + 1:
        raise TurnError(
            f"the markers were seen in {len(rests.q_rad)} poses only",
            "check line of sight and the camera's measurement volume; see ccr-host monitor",
        )
    seen_mm, rows = rests.vectors_mm, np.arange(len(rests.q_rad))
    offset_mm = np.array([0.0, robot.marker_offset_mm, 0.0])
    markers = Markers(tuple(range(len(robot.chain))), offset_mm, are_from_base=True)
    model = ChainModel(robot.chain, robot.pulley_radius_mm * rests.q_rad, markers)
    fit = fit_chain(model, seen_mm, rows)
    to_robot = PAPER_FRAME @ model.turn(fit.score).T
    _require_described_motors(rests.turned(to_robot), description)
    off_mm = fit.predicted_mm(rows) - seen_mm
    left, moved = (
        float(np.sqrt((one**2).sum(axis=-1).mean())) for one in (off_mm, seen_mm - seen_mm.mean(0))
    )
    if left > _MOST_LEFT * moved:
        raise TurnError(
            f"the model leaves {left:.1f} mm RMS of a motion of {moved:.1f} mm",
            "check [[robot.segments]] with its tendons, and that nothing holds the robot",
        )
    covariance = to_robot @ fit.turn_covariance() @ to_robot.T
    deviation_deg = np.degrees(np.sqrt(np.diag(covariance)))
    if deviation_deg.max() > _MAX_UNCERTAINTY_DEG:
        raise TurnError(
            f"the rotation is uncertain by {deviation_deg.max():.1f} deg, "
            f"{_MAX_UNCERTAINTY_DEG:g} are allowed",
            "widen servo.angle_min_deg and angle_max_deg so that the robot can move further",
        )
    return CameraTurn(to_robot, deviation_deg, left)


def _require_described_motors(rests: Rests, description: Description) -> None:
    """Compare the moves of single motors with the description.

    Raises:
        MisfitError: another assignment or direction explains them better.
    """
    led_rad = rests.q_rad - rests.q_rad[0]
    alone = np.flatnonzero((np.count_nonzero(led_rad, axis=1) == 1) & (led_rad.sum(axis=1) > 0.0))
    _, first = np.unique(led_rad[alone].argmax(axis=1), return_index=True)
    rows = np.concatenate([[0], alone[first]])
    if rests.q_rad[0].any() or len(rows) == 1:  # The markers were not seen in the middle.
        return
    chosen = replace(
        rests, q_rad=rests.q_rad[rows], markers_mm=rests.markers_mm[rows], count=rests.count[rows]
    )
    responses = MotorResponses(description, chosen)
    if responses.is_odd() and (found := responses.likeliest().cause_and_cure()):
        raise MisfitError(f"the robot does not move as described; most likely {found[0]}", found[1])
