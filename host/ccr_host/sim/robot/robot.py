"""The simulated robot: servo pulses in, marker positions out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Twin
from ccr_host.sim.robot.mechanics import Mechanics


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


Array = NDArray[np.float64]


class TwinRobot:
    """Servos, tendons and structure, stepped on an integer grid of microseconds.

    It starts at time 0, at rest under gravity, with both servos at 0 deg and without pulses.

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
        """Take both pulse widths in half microseconds from now on; 0 means no pulse."""
        for servo, pulse_half_us in zip(self._servos, pulses_half_us, strict=True):
            servo.set_pulse_us(pulse_half_us / 2)

    def start_path_clock(self, time_us: int) -> None:
        """Set the zero of ``payload_start_s`` and of the push's span; call it once."""
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
        """(3, 3): positions of M1, M2 and M3, one a row, in the frame of (10)."""
        return self._mechanics.markers_mm()

    def tip_mm(self) -> Array:
        """(3,): M3 - M1, the f of (10)."""
        markers_mm = self.markers_mm()
        tip: Array = markers_mm[2] - markers_mm[0]
        return tip

    def backbone_mm(self) -> Array:
        """(1 + flexures, 3): centres of the disks from the base to the tip."""
        return self._mechanics.backbone_mm()

    def servo_angles_rad(self) -> Array:
        """(2,): true shaft angles, the q of (1)."""
        return np.array([servo.angle_rad for servo in self._servos])

    def _turn_servos(self, steps_left: int) -> int:
        """Turn the servos by one step; return how many steps their angles now hold."""
        first, second = self._servos
        if not (first.moving or second.moving):
            until_event = self._events[0][0] - self._steps_done if self._events else steps_left
            return min(steps_left, until_event)
        for servo in self._servos:
            servo.advance(self._mechanics.step_us * 1e-6)
        self._mechanics.pull(first.angle_rad, second.angle_rad)
        return 1
