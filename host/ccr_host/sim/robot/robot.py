"""The simulated robot: servo pulses in, marker positions out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.robot import tendons_of
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.plant import Plant
from ccr_host.sim.robot.servo import ServoModel, ServoProperties

Array = NDArray[np.float64]

_LOAD_US = 10_000
"""Time between two looks of resting servos at their loads; turning ones look at every step."""


class TwinRobot(Plant):
    """Servos, tendons and structure, stepped on an integer grid of microseconds.

    Starts at time 0, at rest under gravity, with all servos at 0 deg and no pulses.

    Args:
        twin: the ``twin`` section of the robot description.

    Raises:
        UnfitTwinError: the description cannot be simulated.
    """

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self._servos = _servos_of(twin)
        self._mechanics = Mechanics(twin, twin.payload_g if twin.payload_start_s == 0 else 0.0)
        step_us = self._mechanics.step_us
        self._lag_steps = round(twin.servo_lag_ms * 1000 / step_us)
        self._load_steps = max(1, _LOAD_US // step_us)
        properties = [servo.properties for servo in self._servos]
        self._feels_load = any(servo.feels_load for servo in properties)
        self._gives_way = any(servo.gives_way for servo in properties)
        self._steps_done = 0
        self._felt_at_step = 0
        self._pulses: deque[tuple[int, tuple[int, ...]]] = deque()
        self._events: deque[tuple[int, Callable[[], None]]] = deque()

    def set_pulses_half_us(self, pulses_half_us: tuple[int, ...]) -> None:
        """Set the pulse widths from now on, (n,), in 0.5 us; 0 means no pulses.

        The servos follow after their lag.
        """
        if self._lag_steps:
            self._pulses.append((self._steps_done + self._lag_steps, pulses_half_us))
        else:
            self._receive(pulses_half_us)

    def _receive(self, pulses_half_us: tuple[int, ...]) -> None:
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
            while self._pulses and self._pulses[0][0] <= self._steps_done:
                self._receive(self._pulses.popleft()[1])
            steps = self._turn_servos(last_step - self._steps_done)
            self._mechanics.advance(steps)
            self._steps_done += steps

    def markers_mm(self) -> Array:
        """Positions of the markers from base to tip, (S + 1, 3), in the frame of (10)."""
        return self._mechanics.markers_mm()

    def backbone_mm(self) -> Array:
        """Centres of the disks from base to tip, (1 + flexures, 3)."""
        return self._mechanics.backbone_mm()

    def servo_angles_rad(self) -> Array:
        """True shaft angles, (n,), the q of (1)."""
        return np.array([servo.angle_rad for servo in self._servos])

    def _turn_servos(self, steps_left: int) -> int:
        """Turn the servos by one step; return the number of steps with these angles."""
        is_due = self._gives_way and self._steps_done % self._load_steps == 0
        if self._feels_load and (is_due or self._moving()):
            self._feel_loads()
        if not self._moving():
            return self._steps_at_rest(steps_left)
        for servo in self._servos:
            servo.advance(self._mechanics.step_us * 1e-6)
        self._pull()
        return 1

    def _moving(self) -> bool:
        return any(servo.moving for servo in self._servos)

    def _pull(self) -> None:
        self._mechanics.pull([servo.angle_rad for servo in self._servos])

    def _feel_loads(self) -> None:
        step_s = self._mechanics.step_us * 1e-6
        time_s = self._steps_done * step_s
        duration_s = (self._steps_done - self._felt_at_step) * step_s
        self._felt_at_step = self._steps_done
        for servo, load_nm in zip(self._servos, self._mechanics.pulley_moments_nm(), strict=True):
            servo.feel(load_nm, time_s, duration_s)
        self._pull()

    def _steps_at_rest(self, steps_left: int) -> int:
        """Number of steps until something may turn a servo, or an event is due."""
        turns = [steps_left]
        if self._events:
            turns.append(self._events[0][0] - self._steps_done)
        if self._pulses:
            turns.append(self._pulses[0][0] - self._steps_done)
        if self._gives_way:
            turns.append(self._load_steps - self._steps_done % self._load_steps)
        return min(turns)


def _servos_of(twin: Twin) -> list[ServoModel]:
    """The servo of each motor."""
    radius_m = twin.pulley_radius_mm * 1e-3
    wound = [tendon.motor - 1 for _, tendon in tendons_of(twin.segments)]
    return [
        ServoModel(
            ServoProperties(
                neutral_us=neutral_us,
                rad_per_us=math.radians(90.0) / us_per_90_deg,
                rate_rad_s=math.radians(twin.servo_rate_deg_s),
                deadband_rad=math.radians(twin.servo_deadband_deg),
                stall_torque_nm=twin.servo_stall_torque_nm or math.inf,
                droop_rad_nm=math.radians(twin.servo_droop_deg_per_nm),
                play_rad=math.radians(twin.servo_backlash_deg),
                drift_rad=math.radians(drift_deg),
                drift_time_s=twin.servo_drift_time_s,
                load_stiffness_nm_rad=wound.count(motor) * twin.tendon_stiffness_n_m * radius_m**2,
            )
        )
        for motor, (neutral_us, us_per_90_deg, drift_deg) in enumerate(
            zip(twin.servo_neutral_us, twin.servo_us_per_90_deg, twin.servo_drift_deg, strict=True)
        )
    ]
