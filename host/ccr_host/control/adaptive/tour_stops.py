"""Where the motors go on the identification motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.excitation import tour_bending_rad
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.robot.workspace import MotorLimits


def tour_stops_rad(p: Parameters, limits: MotorLimits) -> NDArray[np.float64]:
    """Motor angles of the tour's rests, (N, 2), as far as the limits allow.

    Args:
        p: as the robot is believed to be, floats.
        limits: of the motors.
    """
    return limits.clip(unhindered_setpoints_for(p, tour_bending_rad()))
