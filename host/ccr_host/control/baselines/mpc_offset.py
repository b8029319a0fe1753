"""Offset-free MPC: the paper's cost on the model plus an estimated output disturbance.

The disturbance model of dynamic matrix control, with a Kalman filter for its size (Pannocchia and
Rawlings, AIChE J. 49(2), 2003). The measurement is compared with the model at the setpoint that was
in effect when it was taken, so servo and camera delays are not mistaken for a disturbance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.problem import Constants, Tracking, Weights
from ccr_host.control.shell import Law, Measurement, PathView, Plan, believable
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Tuning:
    """Tuning of the disturbance's filter; docs/control-baselines.md describes how it was found."""

    noise_mm: float = 0.3
    """Standard deviation of a measured coordinate, including unmodelled motion."""
    drift_mm: float = 1.0
    """Drift of a coordinate of the disturbance, per square root of a second."""
    first_deviation_mm: float = 20.0
    """Standard deviation of the disturbance before the first measurement."""


class OffsetFreeMpc(Law):
    """min over q_1..q_M of Q sum |f(q_k) + d - f_k|^2 + R sum |q_k - q_(k-1)|^2."""

    name = "mpc-offset"

    def __init__(self, description: Description) -> None:
        control = description.control
        weights = Weights(control.position_weight, control.effort_weight)
        self._constants = Constants.of(description.robot, weights, by_model=True)
        self._model = ConstantCurvature(description.robot)
        limits = MotorLimits.of(description.servo)
        self._bounds = sqp.Bounds.of(limits, control.step_bound_rad)
        self._live_steps = control.horizon - 1
        self._tuning = Tuning()

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self.disturbance_mm = np.zeros(3)
        self._variance_mm2 = self._tuning.first_deviation_mm**2
        self._ahead = np.arange(self._live_steps, dtype=np.float64)
        self._reachable_rad = self._reachable_from(0.0)
        self._plan_rad = self._reachable_rad

    def observe(self, measurement: Measurement) -> None:
        """Make a step of the disturbance's Kalman filter, which is the same for each coordinate."""
        tuning = self._tuning
        expected_mm = self._model.tip_mm(measurement.setpoint_rad) + self.disturbance_mm
        self._variance_mm2 += tuning.drift_mm**2 * measurement.elapsed_s
        gain = self._variance_mm2 / (self._variance_mm2 + tuning.noise_mm**2)
        innovation_mm = believable(measurement.tip_mm - expected_mm)
        self.disturbance_mm = self.disturbance_mm + gain * innovation_mm
        self._variance_mm2 *= 1.0 - gain

    def plan(self, index: float, commanded_rad: FloatArray, time_s: float) -> Plan:
        """Plan the horizon, starting from the last plan shifted along the reachable path."""
        targets_mm = np.array([self.path.target_mm(index + k) for k in self._ahead])
        before_rad, self._reachable_rad = self._reachable_rad, self._reachable_from(index)
        guess_rad = self._plan_rad + self._reachable_rad - before_rad
        offsets_mm = self.disturbance_mm - targets_mm
        problem = Tracking(self._constants, commanded_rad, offsets_mm)
        guess = sqp.feasible(self._bounds, commanded_rad, guess_rad)
        angles = sqp.solve(problem, self._bounds, guess).rollout.angles
        self._plan_rad = sqp.feasible(self._bounds, commanded_rad, angles)
        predicted_mm = self._model.tip_mm(self._plan_rad) + self.disturbance_mm
        return Plan(self._plan_rad[0], predicted_mm)

    def _reachable_from(self, index: float) -> FloatArray:
        return np.array([self.path.reachable_rad(index + k) for k in self._ahead])
