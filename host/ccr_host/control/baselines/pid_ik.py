"""PID on the tip's error, through the inverse kinematics of constant curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.baselines.jacobian_feedback import damped_inverse
from ccr_host.control.shell import Law, Measurement, PathView, Plan, believable
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Tuning:
    """Gains for the error in motor angles; docs/control-baselines.md tells how they were found."""

    proportional: float = 0.1
    integral_time_s: float = 0.05
    """An error seen for T is corrected by the share T / (T + this): 0.95 at 1 Hz, 0.5 at 20 Hz."""
    derivative_s: float = 0.01
    derivative_filter_s: float = 0.1
    damping_mm: float = 15.0
    """Damping of J's inverse, mm/rad; its singular values are about 100 away from the folds."""


class PidIk(Law):
    """Inverse kinematics of the path, plus PID on the error that J's damped inverse turns into q.

    The error refers to the setpoint in effect when the picture was taken, so delays cause no error
    while the path advances.
    """

    name = "pid-ik"

    def __init__(self, description: Description) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)
        self._tuning = Tuning()

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._error_rad: FloatArray | None = None
        self._rate_rad_s = np.zeros(self._model.motors)
        self.integral_rad = np.zeros(self._model.motors)

    def observe(self, measurement: Measurement) -> None:
        """Integrate and differentiate the error over the time between measurements."""
        if measurement.index is None:
            return
        tuning, elapsed_s = self._tuning, measurement.elapsed_s
        error_mm = believable(self.path.target_mm(measurement.index) - measurement.tip_mm)
        jacobian = self._model.jacobian_mm_rad(self.path.reachable_rad(measurement.index))
        error_rad = damped_inverse(jacobian, tuning.damping_mm) @ error_mm
        if self._error_rad is not None:
            rate_rad_s = (error_rad - self._error_rad) / elapsed_s
            share = elapsed_s / (elapsed_s + tuning.derivative_filter_s)
            self._rate_rad_s = self._rate_rad_s + share * (rate_rad_s - self._rate_rad_s)
        self._error_rad = error_rad
        gain = elapsed_s / (elapsed_s + tuning.integral_time_s)
        self.integral_rad = self.integral_rad + gain * error_rad

    def plan(self, index: float, commanded_rad: FloatArray, time_s: float) -> Plan:
        """Plan feedforward plus PID; the integral is reduced by what the motor limits cut off."""
        tuning = self._tuning
        reachable_rad = self.path.reachable_rad(index)
        wanted_rad = reachable_rad + self.integral_rad + tuning.derivative_s * self._rate_rad_s
        if self._error_rad is not None:
            wanted_rad = wanted_rad + tuning.proportional * self._error_rad
        q_rad = self._limits.clip(wanted_rad)
        self.integral_rad = self.integral_rad + (q_rad - wanted_rad)
        return Plan(q_rad, self._model.tip_mm(reachable_rad)[None])
