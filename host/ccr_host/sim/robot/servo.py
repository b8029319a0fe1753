"""A hobby servo: pulse width and load in, angle of the output shaft out."""

from __future__ import annotations

import math
from dataclasses import dataclass

_LOOP_S = 0.02
"""Time constant of the position loop: an analogue servo drives its motor once per pulse."""
_PLAY_DAMPING_NM_S = 0.01
"""Drag of the output gear within its play: a load of 0.1 N m crosses 0.65 deg in 1 ms."""


@dataclass(frozen=True)
class ServoProperties:
    """A servo; the defaults of the last six are those of a servo that no load can disturb."""

    neutral_us: float
    """Pulse width for 0 rad."""
    rad_per_us: float
    """Change of angle per microsecond of pulse width."""
    rate_rad_s: float
    """No-load speed."""
    deadband_rad: float = 0.0
    """The motor does not move while its target is no further away than this."""
    stall_torque_nm: float = math.inf
    """Opposing load at which the speed, which falls linearly with it, is zero."""
    droop_rad_nm: float = 0.0
    """Steady deviation of the position loop per torque."""
    play_rad: float = 0.0
    """Play of the gear train between its two ends."""
    drift_rad: float = 0.0
    """Final drift of the neutral position after power-up."""
    drift_time_s: float = math.inf
    """Time constant of that drift."""
    load_stiffness_nm_rad: float = 0.0
    """Greatest change of load with the angle of the shaft; keeps stiff tendons from chattering."""

    @property
    def feels_load(self) -> bool:
        """Whether `ServoModel.feel` has any effect."""
        return self.stall_torque_nm < math.inf or self.gives_way

    @property
    def gives_way(self) -> bool:
        """Whether it has an effect on a servo at rest too."""
        return bool(self.droop_rad_nm or self.play_rad or self.drift_rad)


class ServoModel:
    """A servo that turns towards its target and stops at the deadband's edge.

    Under a load it is slower, its target is shifted by the droop of its position loop, and the
    output shaft lies at that end of the gears' play to which the load pushes it; without a load it
    stays where it is until the gears take it along. Without pulses the motor does not move: the
    gear train is assumed to hold against the tendons. It starts at 0 rad.
    """

    def __init__(self, properties: ServoProperties) -> None:
        self.properties = properties
        self._rate_rad_s = properties.rate_rad_s
        self._half_play_rad = properties.play_rad / 2
        self._pulse_us = 0.0
        self._goal_rad = 0.0
        self._load_nm = 0.0
        self._droop_rad = 0.0
        self._drift_rad = 0.0
        self._motor_rad = 0.0
        self.angle_rad = 0.0
        """Angle of the output shaft."""
        self.moving = False
        """Whether the motor turns."""

    def set_pulse_us(self, pulse_us: float) -> None:
        """Set the width of the pulses received from now on; 0 means no pulses."""
        self._pulse_us = pulse_us
        self._aim()

    def feel(self, load_nm: float, time_s: float, duration_s: float) -> None:
        """Let a load act for a while, and the neutral position drift.

        Args:
            load_nm: moment on the shaft, positive if it turns it to greater angles.
            time_s: time since power-up.
            duration_s: time since the last call.
        """
        servo = self.properties
        self._load_nm = load_nm
        # Both implicit: the load gives way as the shaft does.
        follows = 1 + servo.droop_rad_nm * servo.load_stiffness_nm_rad
        self._droop_rad += (
            (servo.droop_rad_nm * load_nm - self._droop_rad)
            * duration_s
            / (_LOOP_S + follows * duration_s)
        )
        if self._half_play_rad:
            drag_nm_s = _PLAY_DAMPING_NM_S + servo.load_stiffness_nm_rad * duration_s
            self._place_output(self.angle_rad + load_nm * duration_s / drag_nm_s)
        if servo.drift_rad:
            self._drift_rad = servo.drift_rad * -math.expm1(-time_s / servo.drift_time_s)
        self._aim()

    def advance(self, duration_s: float) -> None:
        """Turn for ``duration_s``; ``moving`` becomes false on arrival."""
        if not self.moving:
            return
        error_rad = self._goal_rad - self._motor_rad
        left_rad = abs(error_rad) - self.properties.deadband_rad
        travel_rad = self._rate_rad_s * duration_s
        if travel_rad < left_rad:
            self._motor_rad += math.copysign(travel_rad, error_rad)
        else:
            self._motor_rad = self._goal_rad - math.copysign(
                self.properties.deadband_rad, error_rad
            )
            self.moving = False
        self._place_output(self.angle_rad)

    def _place_output(self, wanted_rad: float) -> None:
        """Put the output shaft as near to an angle as the play of the gears lets it."""
        half_rad, motor_rad = self._half_play_rad, self._motor_rad
        self.angle_rad = min(max(wanted_rad, motor_rad - half_rad), motor_rad + half_rad)

    def _aim(self) -> None:
        """Set goal and speed from pulse, droop, drift and load."""
        servo = self.properties
        if self._pulse_us <= 0:
            self.moving = False
            return
        described_rad = (self._pulse_us - servo.neutral_us) * servo.rad_per_us
        self._goal_rad = described_rad + self._droop_rad + self._drift_rad
        error_rad = self._goal_rad - self._motor_rad
        self.moving = abs(error_rad) > servo.deadband_rad
        against_nm = -math.copysign(self._load_nm, self._load_nm * error_rad)
        left = 1 - max(0.0, against_nm) / servo.stall_torque_nm
        self._rate_rad_s = servo.rate_rad_s * max(0.0, left)
