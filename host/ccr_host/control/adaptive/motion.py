"""How the robot comes to rest where it does: play of the servos, friction of the tendons.

Both remember only how far and which way the servos went, not how fast.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.either import within
from ccr_host.control.adaptive.parameters import FloatArray, Parameters
from ccr_host.control.adaptive.statics import (
    STICKING,
    Drive,
    likely_bending_rad,
    rest_at,
    routes_at,
    zeros_rad,
)
from ccr_host.robot.arc import Number

LONGEST_STEP_RAD = np.radians(8.0)
"""Of a motor: over so much it moves the segments one way or the other, not to and fro."""
_LEAST_PLAY_RAD = 1e-4
_UNMOVED_RAD = np.radians(0.1)
"""Of a shaft: a wish to turn it back by less does not take up the whole play."""


class Rest(NamedTuple):
    """A pose at rest and what holds it: ``theta_rad`` (..., 2)."""

    drive: Drive
    theta_rad: FloatArray


def held_after(p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
    """``moved``, for those who want to know what holds the robot but not its pose."""
    if p.friction_1 > 0.0:
        return moved(p, rest, setpoint_rad)
    lag = _lag_after(p, rest, setpoint_rad - rest.drive.setpoint_rad)
    return rest._replace(drive=rest.drive._replace(setpoint_rad=setpoint_rad, lag=lag))


def first_rest(p: Parameters, setpoint_rad: FloatArray) -> Rest:
    """At rest without having come from any side; setpoint (..., 2)."""
    nowhere = np.zeros_like(setpoint_rad)
    guess = likely_bending_rad(p, setpoint_rad)
    free = p._replace(friction_1=0.0 * p.friction_1)
    theta = rest_at(free, Drive(setpoint_rad, nowhere, routes_at(p, guess)), guess)
    return Rest(Drive(setpoint_rad, nowhere, routes_at(p, theta)), theta)


def moved(p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
    """The rest after the setpoints have gone straight to new ones, (2,) each."""
    travel = setpoint_rad - rest.drive.setpoint_rad
    steps = int(np.ceil(np.abs(travel).max() / LONGEST_STEP_RAD))
    for _ in range(steps):
        rest = stepped(p, rest, travel / steps)
    return rest


def shifted(before: Parameters, after: Parameters, rest: Rest, theta_rad: FloatArray) -> Rest:
    """The rest moved to where a corrected model has it: what slides keeps sliding."""
    slid = rest.drive.anchor - routes_at(before, rest.theta_rad)
    return Rest(rest.drive._replace(anchor=routes_at(after, theta_rad) + slid), theta_rad)


def setpoint_for(p: Parameters, drive: Drive, shaft_rad: FloatArray) -> FloatArray:
    """Setpoint that takes the shafts from where they are to given angles, past their play, (2,)."""
    lag = drive.lag
    wanted = shaft_rad + zeros_rad(p)
    turned = lag + (wanted - drive.setpoint_rad + p.play_rad * lag) / _UNMOVED_RAD
    return np.asarray(wanted + p.play_rad * within(turned, 1.0))


def stepped(p: Parameters, rest: Rest, travel_rad: FloatArray) -> Rest:
    """The rest after one short motion of the setpoints, (..., 2)."""
    lag = _lag_after(p, rest, travel_rad)
    drive = Drive(rest.drive.setpoint_rad + travel_rad, lag, rest.drive.anchor)
    theta = rest_at(p, drive, rest.theta_rad)
    routes = routes_at(p, theta)
    dragged = routes - within(routes - drive.anchor, STICKING)
    return Rest(drive._replace(anchor=dragged), theta)


def _lag_after(p: Parameters, rest: Rest, travel_rad: FloatArray) -> FloatArray:
    lag = rest.drive.lag
    return np.asarray(lag_of(np.expand_dims(p.play_rad, -1), lag, travel_rad))


def lag_of(play_rad: Number, lag: Number, travel_rad: Number) -> Number:
    """Share of the play by which servos stay behind, -1 to 1, after they have turned on."""
    return within(lag + travel_rad / np.maximum(play_rad, _LEAST_PLAY_RAD), 1.0)
