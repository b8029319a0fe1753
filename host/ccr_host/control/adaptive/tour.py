"""The tour of rests of the paper's robot."""

from __future__ import annotations

import numpy as np

from ccr_host.control.adaptive.arithmetic import FloatArray
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.robot.workspace import MotorLimits

_ROWS_RAD = np.radians((0.0, 50.0, 100.0, -100.0, -50.0))
_COLUMNS_RAD = np.radians((-110.0, -40.0, 40.0, 110.0))


def tour_bending_rad() -> FloatArray:
    """Bending angles at which all parameters are observable, (N, 2), in an order of short moves.

    They cover the workspace: only large bends distinguish the camera's rotation from the robot's
    sag.
    """
    stops: list[tuple[float, float]] = []
    for number, row in enumerate(_ROWS_RAD):
        columns = _COLUMNS_RAD if number % 2 == 0 else _COLUMNS_RAD[::-1]
        stops.extend((row, column) for column in columns)
    return np.array(stops)


def tour_stops_rad(p: Parameters, limits: MotorLimits) -> FloatArray:
    """Motor angles of the tour's rests, (N, 2), as far as the limits allow.

    Args:
        p: believed parameters of the robot, floats.
        limits: limits of the motors.
    """
    return limits.clip(unhindered_setpoints_for(p, tour_bending_rad()))
