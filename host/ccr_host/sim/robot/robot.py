"""The simulated robot: servo pulses in, marker positions out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.plant import Plant


class ServoModel:
    """A servo that turns towards its target at a constant rate and stops at the deadband's edge.

    Without pulses it does not move: its gear train is assumed to hold the shaft against the
    tendons. It starts at 0 rad.

    Args:
        neutral_us: pulse width for 0 rad.
        rad_per_us: change of angle per microsecond of pulse width.
        rate_rad_s: no-load speed.
        deadband_rad: the shaft does not move while its target is no further away than this.
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
        """Set the width of the pulses received from now on; 0 means no pulses."""
        if pulse_us > 0:
            self._goal_rad = (pulse_us - self._neutral_us) * self._rad_per_us
            self.moving = abs(self._goal_rad - self.angle_rad) > self._deadband_rad
        else:
            self.moving = False

    def advance(self, duration_s: float) -> None:
        """Turn for ``duration_s``; ``moving`` becomes false on arrival."""
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


Array = NDArray[np.float64]


class TwinRobot(Plant):
    """Servos, tendons and structure, stepped on an integer grid of microseconds.

    Starts at time 0, at rest under gravity, with both servos at 0 deg and no pulses.

    Args:
        twin: the ``twin`` section of the robot description.

    Raises:
        UnfitTwinError: the description cannot be simulated.
    """

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self._servos = tuple(
            ServoModel(
                neutral_us,
                math.radians(90.0) / us_per_90_deg,
                math.radians(twin.servo_rate_deg_s),
                math.radians(twin.servo_deadband_deg),
            )
            for neutral_us, us_per_90_deg in zip(
                twin.servo_neutral_us, twin.servo_us_per_90_deg, strict=True
            )
        )
        self._mechanics = Mechanics(twin, twin.payload_g if twin.payload_start_s == 0 else 0.0)
        self._steps_done = 0
        self._events: deque[tuple[int, Callable[[], None]]] = deque()

    def set_pulses_half_us(self, pulses_half_us: tuple[int, int]) -> None:
        """Set both pulse widths from now on, in 0.5 us; 0 means no pulses."""
        for servo, pulse_half_us in zip(self._servos, pulses_half_us, strict=True):
            servo.set_pulse_us(pulse_half_us / 2)

    def start_path_clock(self, time_us: int) -> None:
        """Set the zero of ``payload_start_s`` and of the push's times; call it once."""
        twin, mechanics = self._twin, self._mechanics
        events: list[tuple[float, Callable[[], None]]] = []
        if twin.payload_start_s > 0:
            events.append((twin.payload_start_s, lambda: mechanics.set_payload(twin.payload_g)))
        if twin.push is not None:
            force_n = twin.push.force_n
            events.append((twin.push.start_s, lambda: mechanics.push(force_n)))
            events.append((twin.push.end_s, lambda: mechanics.push((0.0, 0.0, 0.0))))
        self._events = deque(
            (math.ceil((time_us + at_s * 1e6) / mechanics.step_us), action)
            for at_s, action in sorted(events, key=lambda event: event[0])
        )

    def advance_to(self, time_us: int) -> None:
        """Simulate up to the last grid point at or before a time.

        Raises:
            CcrError: the simulation became unstable.
        """
        last_step = time_us // self._mechanics.step_us
        while self._steps_done < last_step:
            while self._events and self._events[0][0] <= self._steps_done:
                self._events.popleft()[1]()
            steps = self._turn_servos(last_step - self._steps_done)
            self._mechanics.advance(steps)
            self._steps_done += steps

    def markers_mm(self) -> Array:
        """Positions of M1, M2 and M3, one per row, (3, 3), in the frame of (10)."""
        return self._mechanics.markers_mm()

    def backbone_mm(self) -> Array:
        """Centres of the disks from base to tip, (1 + flexures, 3)."""
        return self._mechanics.backbone_mm()

    def servo_angles_rad(self) -> Array:
        """True shaft angles, (2,), the q of (1)."""
        return np.array([servo.angle_rad for servo in self._servos])

    def _turn_servos(self, steps_left: int) -> int:
        """Turn the servos by one step; return the number of steps with these angles."""
        first, second = self._servos
        if not (first.moving or second.moving):
            until_event = self._events[0][0] - self._steps_done if self._events else steps_left
            return min(steps_left, until_event)
        for servo in self._servos:
            servo.advance(self._mechanics.step_us * 1e-6)
        self._mechanics.pull(first.angle_rad, second.angle_rad)
        return 1
