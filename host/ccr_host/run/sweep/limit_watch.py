"""Whether a run stayed within the robot's limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Servo
from ccr_host.link.messages import TICK_US, StateReport
from ccr_host.run.observer import RunObserver, RunSetup
from ccr_host.run.step_record import StepRecord

_CDEG_PER_DEG = 100.0
_CDEG_ROUNDING = 1.0
_PULSE_ROUNDING_US = 0.5
_RAD_ROUNDING = 1e-9


class LimitWatch(RunObserver):
    """Checks commands, and the board's targets, setpoints, rates and pulses, against the limits."""

    def __init__(self) -> None:
        self.violations: set[str] = set()
        """What was outside: command, target, setpoint, slew, pulse."""
        self._last: StateReport | None = None

    def begin(self, setup: RunSetup) -> None:
        servo = setup.description.servo
        self._low_deg, self._high_deg = np.array(servo.angle_min_deg), np.array(servo.angle_max_deg)
        self._slew_deg_s = np.array(servo.slew_deg_s)
        self._low_us, self._high_us = _pulse_limits_us(servo)

    def step(self, record: StepRecord) -> None:
        self._check_angles("command", np.degrees(record.q_rad), np.degrees(_RAD_ROUNDING))

    def state(self, time_us: int, report: StateReport) -> None:
        rounding_deg = _CDEG_ROUNDING / _CDEG_PER_DEG
        setpoint_deg = np.array(report.setpoint_cdeg) / _CDEG_PER_DEG
        self._check_angles("target", np.array(report.target_cdeg) / _CDEG_PER_DEG, rounding_deg)
        self._check_angles("setpoint", setpoint_deg, rounding_deg)
        if self._last is not None:
            travel_deg = setpoint_deg - np.array(self._last.setpoint_cdeg) / _CDEG_PER_DEG
            period_s = (report.tick - self._last.tick) * TICK_US * 1e-6
            self._check("slew", np.abs(travel_deg) <= self._slew_deg_s * period_s + rounding_deg)
        pulses_us = np.array(report.pulse_half_us) / 2
        inside = (pulses_us >= self._low_us) & (pulses_us <= self._high_us)
        self._check("pulse", inside | (pulses_us == 0))
        self._last = report

    def _check_angles(self, what: str, angles_deg: NDArray[np.float64], rounding: float) -> None:
        low, high = self._low_deg - rounding, self._high_deg + rounding
        self._check(what, (angles_deg >= low) & (angles_deg <= high))

    def _check(self, what: str, good: NDArray[np.bool_]) -> None:
        if not good.all():
            self.violations.add(what)


def _pulse_limits_us(servo: Servo) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shortest and longest pulse that the limits of angle and pulse leave, (2,) each."""
    at_limits_us = np.array(servo.neutral_pulse_us) + np.array(
        [servo.angle_min_deg, servo.angle_max_deg]
    ) / 90.0 * np.array(servo.pulse_per_90_deg_us)
    low = np.maximum(at_limits_us.min(axis=0), servo.pulse_min_us) - _PULSE_ROUNDING_US
    high = np.minimum(at_limits_us.max(axis=0), servo.pulse_max_us) + _PULSE_ROUNDING_US
    return low, high
