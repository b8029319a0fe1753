"""``ccr-host calibrate --identify``: a tour of rests, kept as measured for `adaptive` to fit."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Array

from ccr_host.config import Description
from ccr_host.control.adaptive.excitation import tour_bending_rad
from ccr_host.control.adaptive.identification import Fit, Rests, Scaling
from ccr_host.control.adaptive.identified import digest_of
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.control.adaptive.rest_survey import fit_to
from ccr_host.control.adaptive.statics import unhindered_shafts_for
from ccr_host.errors import TrackerError
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import RestMotion
from ccr_host.run.rig import Rig

SECTION = "identified"
OnPose = Callable[[int, int], None]
"""Number of poses done, and of all."""
_ANGLE_DECIMALS, _LENGTH_DECIMALS = 6, 4


def measure_rests(rig: Rig, description: Description, on_pose: OnPose) -> Rests:
    """Arm, visit the rests of the controller's own tour, averaging at each, disarm.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        RegistrationError: the robot does not come to rest.
    """
    prior = Scaling(description.robot).parameters(np.zeros(COUNT))
    limits = MotorLimits.of(description.servo)
    stops = limits.clip(unhindered_shafts_for(prior, tour_bending_rad()))
    motion = RestMotion(rig)
    rig.client.arm()
    motion.start()
    start_rad = np.array(rig.client.accepted_rad)
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
    return Rests(
        start_rad=start_rad,
        setpoint_rad=np.array([pose.q_rad for pose in poses]).reshape(-1, 2),
        tip_mm=np.array([pose.markers_mm[2] - pose.markers_mm[0] for pose in poses]).reshape(-1, 3),
        count=np.array([pose.count for pose in poses], dtype=np.float64),
    )


def trial_fit(rests: Rests, description: Description) -> Fit:
    """Fit the controller's model as it will do, to see whether the rests are good for it.

    Raises:
        TrackerError: no robot of the kind rests there.
    """
    fit = fit_to(Scaling(description.robot), rests)
    if fit is None:
        raise TrackerError(
            f"{len(rests.count)} rests were seen, and no robot as described rests there",
            "check the markers with ccr-host monitor, and segment lengths and pulleys in [robot]",
        )
    while fit.improve():
        pass
    return fit.result()


def identified_section(
    rests: Rests, description: Description, date: datetime.date
) -> dict[str, Any]:
    """The keys of ``[identified]``, rounded to less than the board or the camera resolves."""
    return {
        "start_rad": rests.start_rad.round(_ANGLE_DECIMALS).tolist(),
        "setpoint_rad": _rows(rests.setpoint_rad.round(_ANGLE_DECIMALS).tolist()),
        "tip_mm": _rows(rests.tip_mm.round(_LENGTH_DECIMALS).tolist()),
        "count": [int(count) for count in rests.count],
        "valid_for": digest_of(description),
        "date": date,
    }


def _rows(rows: list[list[float]]) -> Array:
    array = tomlkit.array()
    array.extend(rows)
    return array.multiline(True)
