"""One hobby servo: pulse width in, shaft angle out."""

from __future__ import annotations

import math


class ServoModel:
    """A servo that turns towards its goal at a constant rate and stops at the deadband's edge.

    Without pulses it is passive: its gear train is taken to hold the shaft against the tendons.

    It starts at 0 rad.

    Args:
        neutral_us: pulse at which it stands at 0 rad.
        rad_per_us: how far it turns for each microsecond more.
        rate_rad_s: no-load speed.
        deadband_rad: the shaft rests while its goal is no further away than this.
    """

    def __init__(
        self, neutral_us: float, rad_per_us: float, rate_rad_s: float, deadband_rad: float
    ) -> None:
        self._neutral_us = neutral_us
        self._rad_per_us = rad_per_us
        self._rate_rad_s = rate_rad_s
        self._deadband_rad = deadband_rad
        self._goal_rad = 0.0
        self.angle_rad = 0.0
        self.moving = False

    def set_pulse_us(self, pulse_us: float) -> None:
        """Take the width of the pulses that arrive from now on; 0 when none do."""
        if pulse_us > 0:
            self._goal_rad = (pulse_us - self._neutral_us) * self._rad_per_us
            self.moving = abs(self._goal_rad - self.angle_rad) > self._deadband_rad
        else:
            self.moving = False

    def advance(self, duration_s: float) -> None:
        """Turn for a while; ``moving`` turns false on arrival."""
        if not self.moving:
            return
        error_rad = self._goal_rad - self.angle_rad
        left_rad = abs(error_rad) - self._deadband_rad
        travel_rad = self._rate_rad_s * duration_s
        if travel_rad < left_rad:
            self.angle_rad += math.copysign(travel_rad, error_rad)
        else:
            self.angle_rad = self._goal_rad - math.copysign(self._deadband_rad, error_rad)
            self.moving = False
