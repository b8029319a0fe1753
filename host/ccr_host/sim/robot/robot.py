"""The simulated robot and its hobby servos: servo pulses in, marker positions out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.description.robot import tendons_of
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.plant import Plant

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


_LOAD_US = 10_000
"""Time between two looks of resting servos at their loads; turning ones look at every step."""


class TwinRobot(Plant):
    """Servos, tendons and structure, stepped on an integer grid of microseconds.

    Starts at time 0, at rest under gravity, with all servos at 0 deg and no pulses.

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
