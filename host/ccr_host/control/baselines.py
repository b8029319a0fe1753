"""Controllers from the literature, for comparison: laws of one `Shell`.

`PidIk` is a PID on the tip's error, through the inverse kinematics of constant curvature.
`Broyden` and `KalmanJacobian` servo on an estimated Jacobian; the robot's model is only its first
guess. `OffsetFreeMpc` minimises the paper's cost on the model plus an estimated output disturbance:
the disturbance model of dynamic matrix control, with a Kalman filter for its size (Pannocchia and
Rawlings, AIChE J. 49(2), 2003). Measurements are compared with the model or the path at the
setpoint in effect when they were taken, so servo and camera delays are not mistaken for errors.
docs/control-baselines.md describes how the constants were found.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.problem import Constants, Tracking, Weights
from ccr_host.control.shell import NOTHING_MM, Law, Measurement, PathView, Plan, believable
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits


def damped_inverse(jacobian: Array, damping: float) -> Array:
    """(J'J + damping^2 I)^-1 J', (n, 3) of a (3, n) Jacobian; finite for any damping above 0."""
    gram = jacobian.T @ jacobian + damping**2 * np.eye(jacobian.shape[1])
    return np.asarray(np.linalg.solve(gram, jacobian.T))


class PidIk(Law):
    """Inverse kinematics of the path, plus PID on the error that J's damped inverse turns into q.

    The error refers to the setpoint in effect when the picture was taken, so delays cause no error
    while the path advances.
    """

    name = "pid-ik"

    _PROPORTIONAL = 0.1
    _INTEGRAL_TIME_S = 0.05
    """An error seen for T is corrected by the share T / (T + this): 0.95 at 1 Hz, 0.5 at 20 Hz."""
    _DERIVATIVE_S = 0.01
    _DERIVATIVE_FILTER_S = 0.1
    _DAMPING_MM = 15.0
    """Damping of J's inverse, mm/rad; its singular values are about 100 away from the folds."""

    def __init__(self, description: Description) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._error_rad: Array | None = None
        self._rate_rad_s = np.zeros(self._model.motors)
        self.integral_rad = np.zeros(self._model.motors)

    def observe(self, measurement: Measurement) -> None:
        """Integrate and differentiate the error over the time between measurements."""
        if measurement.index is None:
            return
        elapsed_s = measurement.elapsed_s
        error_mm = believable(self.path.target_mm(measurement.index) - measurement.tip_mm)
        jacobian = self._model.jacobian_mm_rad(self.path.reachable_rad(measurement.index))
        error_rad = damped_inverse(jacobian, self._DAMPING_MM) @ error_mm
        if self._error_rad is not None:
            rate_rad_s = (error_rad - self._error_rad) / elapsed_s
            share = elapsed_s / (elapsed_s + self._DERIVATIVE_FILTER_S)
            self._rate_rad_s = self._rate_rad_s + share * (rate_rad_s - self._rate_rad_s)
        self._error_rad = error_rad
        gain = elapsed_s / (elapsed_s + self._INTEGRAL_TIME_S)
        self.integral_rad = self.integral_rad + gain * error_rad

    def plan(self, index: float, commanded_rad: Array, time_s: float) -> Plan:
        """Plan feedforward plus PID; the integral is reduced by what the motor limits cut off."""
        reachable_rad = self.path.reachable_rad(index)
        wanted_rad = reachable_rad + self.integral_rad + self._DERIVATIVE_S * self._rate_rad_s
        if self._error_rad is not None:
            wanted_rad = wanted_rad + self._PROPORTIONAL * self._error_rad
        q_rad = self._limits.clip(wanted_rad)
        self.integral_rad = self.integral_rad + (q_rad - wanted_rad)
        return Plan(q_rad, self._model.tip_mm(reachable_rad)[None])


class JacobianFeedback(Law):
    """q += J^+ (path's step + part of the error), with damped J^+ and J estimated during motion.

    ``jacobian_mm_rad`` is J, (3, n).
    """

    _INTEGRAL_TIME_S = 0.06
    """An error seen for T is corrected by the share T / (T + this): 0.94 at 1 Hz, 0.45 at 20 Hz."""
    _DAMPING_MM = 20.0
    """Damping of the inverse, mm/rad; singular values are about 100 away from the folds."""
    _LONGEST_MOVE_RAD = 0.3
    """Limit of one command: two or three of the paper's longest steps at 1 Hz."""
    _FASTEST_RAD_S = 1.0
    """Five times the fastest rate of the paths; a vanishing J would demand any rate."""
    _MOTION_THRESHOLD_RAD = 0.03
    """Shorter motions, 3 mm of the tip, are not informative at 0.25 mm of noise."""

    def __init__(self, description: Description) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        """Begin a path with the model's J at the first point."""
        super().start(path, history)
        self.guess(self._model.jacobian_mm_rad(path.reachable_rad(0.0)))
        self._newest: Measurement | None = None
        self._elapsed_s = path.period_s
        self._anchor: Measurement | None = None
        self._target_mm = path.target_mm(0.0)
        self._correction_mm = np.zeros(3)

    def observe(self, measurement: Measurement) -> None:
        """Pass on a secant once the motors have turned far enough, and note the error."""
        self._newest = measurement
        self._elapsed_s = measurement.elapsed_s
        self._learn(measurement)
        if measurement.index is None:
            return
        error_mm = believable(self.path.target_mm(measurement.index) - measurement.tip_mm)
        share = measurement.elapsed_s / (measurement.elapsed_s + self._INTEGRAL_TIME_S)
        self._correction_mm = self._correction_mm + share * error_mm

    def plan(self, index: float, commanded_rad: Array, time_s: float) -> Plan:
        """Plan an increment; what the limits cut off is discarded."""
        target_mm = self.path.target_mm(index)
        wanted_mm = target_mm - self._target_mm + self._correction_mm
        self._target_mm, self._correction_mm = target_mm, np.zeros(3)
        jacobian = self.jacobian_mm_rad
        turn_rad = damped_inverse(jacobian, self._DAMPING_MM) @ wanted_mm
        longest_rad = min(self._LONGEST_MOVE_RAD, self._FASTEST_RAD_S * self._elapsed_s)
        turn_rad = turn_rad * min(1.0, longest_rad / max(float(np.abs(turn_rad).max()), 1e-9))
        q_rad = self._limits.clip(commanded_rad + turn_rad)
        if self._newest is None:
            return Plan(q_rad, NOTHING_MM)
        moved_mm = jacobian @ (q_rad - self._newest.setpoint_rad)
        return Plan(q_rad, (self._newest.tip_mm + moved_mm)[None])

    def _learn(self, measurement: Measurement) -> None:
        if self._anchor is not None:
            turn_rad = measurement.setpoint_rad - self._anchor.setpoint_rad
            if float(np.linalg.norm(turn_rad)) < self._MOTION_THRESHOLD_RAD:
                return
            self.correct(turn_rad, measurement.tip_mm - self._anchor.tip_mm)
        self._anchor = measurement

    def guess(self, jacobian_mm_rad: Array) -> None:
        """Reset the estimate of J."""
        self.jacobian_mm_rad = jacobian_mm_rad

    @abstractmethod
    def correct(self, turn_rad: Array, move_mm: Array) -> None:
        """Process a secant: turn of the motors, (n,), not zero, and move of the tip, (3,)."""


class Broyden(JacobianFeedback):
    """Visual servoing with J += rate (dx - J dq) dq' / (dq'dq + regularisation^2).

    As in uncalibrated visual servoing (Jagersand, Fuentes, Nelson, ICRA 1997); the least change of
    J that explains a motion, as Yip and Camarillo estimate it (IEEE T-RO 30(4), 2014), is Broyden's
    update as long as no constraint is active.
    """

    name = "broyden"

    _RATE = 0.5
    """1 fits the newest secant, a lower rate averages several."""
    _REGULARISATION_RAD = 0.03
    """Turns well below this change J little."""

    def correct(self, turn_rad: Array, move_mm: Array) -> None:
        residual_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        weight = self._RATE / (turn_rad @ turn_rad + self._REGULARISATION_RAD**2)
        self.jacobian_mm_rad = self.jacobian_mm_rad + weight * np.outer(residual_mm, turn_rad)


class KalmanJacobian(JacobianFeedback):
    """Visual servoing with a Kalman filter whose state is the entries of J.

    As in model-free control of continuum robots (Li, Kang, Branson, Dai, IEEE/ASME T-Mech 23(1),
    2018): the entries follow random walks, each motion dx = J dq + noise measures them. The
    rows of J share one covariance, (n, n): their regressors and noises are the same.
    """

    name = "kalman-jacobian"

    _DEVIATION_MM_RAD = 40.0
    """Standard deviation of the first guess."""
    _WALK_MM_RAD = 15.0
    """Random walk of an entry per square root of a radian turned."""
    _NOISE_MM = 1.5
    """Noise of a measured motion, including nonlinearity."""

    def guess(self, jacobian_mm_rad: Array) -> None:
        super().guess(jacobian_mm_rad)
        self._covariance = self._DEVIATION_MM_RAD**2 * np.eye(jacobian_mm_rad.shape[1])

    def correct(self, turn_rad: Array, move_mm: Array) -> None:
        turned_rad = float(np.linalg.norm(turn_rad))
        walk = self._WALK_MM_RAD**2 * turned_rad * np.eye(len(turn_rad))
        covariance = self._covariance + walk
        variance_mm2 = turn_rad @ covariance @ turn_rad + self._NOISE_MM**2
        gain = covariance @ turn_rad / variance_mm2
        innovation_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        self.jacobian_mm_rad = self.jacobian_mm_rad + np.outer(innovation_mm, gain)
        self._covariance = covariance - variance_mm2 * np.outer(gain, gain)


class OffsetFreeMpc(Law):
    """min over q_1..q_M of Q sum |f(q_k) + d - f_k|^2 + R sum |q_k - q_(k-1)|^2."""

    name = "mpc-offset"

    _NOISE_MM = 0.3
    """Standard deviation of a measured coordinate, including unmodelled motion."""
    _DRIFT_MM = 1.0
    """Drift of a coordinate of the disturbance, per square root of a second."""
    _FIRST_DEVIATION_MM = 20.0
    """Standard deviation of the disturbance before the first measurement."""

    def __init__(self, description: Description) -> None:
        control = description.control
        weights = Weights.papers(control.position_weight, control.effort_weight)
        self._constants = Constants.of(description.robot, weights, by_model=True)
        self._model = ConstantCurvature(description.robot)
        limits = MotorLimits.of(description.servo)
        self._bounds = sqp.Bounds.of(limits, control.step_bound_rad)
        self._live_steps = control.horizon - 1

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self.disturbance_mm = np.zeros(3)
        self._variance_mm2 = self._FIRST_DEVIATION_MM**2
        self._ahead = np.arange(self._live_steps, dtype=np.float64)
        self._reachable_rad = self._reachable_from(0.0)
        self._plan_rad = self._reachable_rad

    def observe(self, measurement: Measurement) -> None:
        """Make a step of the disturbance's Kalman filter, which is the same for each coordinate."""
        expected_mm = self._model.tip_mm(measurement.setpoint_rad) + self.disturbance_mm
        self._variance_mm2 += self._DRIFT_MM**2 * measurement.elapsed_s
        gain = self._variance_mm2 / (self._variance_mm2 + self._NOISE_MM**2)
        innovation_mm = believable(measurement.tip_mm - expected_mm)
        self.disturbance_mm = self.disturbance_mm + gain * innovation_mm
        self._variance_mm2 *= 1.0 - gain

    def plan(self, index: float, commanded_rad: Array, time_s: float) -> Plan:
        """Plan the horizon, starting from the last plan shifted along the reachable path."""
        targets_mm = np.array([self.path.target_mm(index + k) for k in self._ahead])
        before_rad, self._reachable_rad = self._reachable_rad, self._reachable_from(index)
        guess_rad = self._plan_rad + self._reachable_rad - before_rad
        offsets_mm = self.disturbance_mm - targets_mm
        still = np.zeros_like(guess_rad)
        problem = Tracking(self._constants, commanded_rad, offsets_mm, still, still[0])
        guess = sqp.feasible(self._bounds, commanded_rad, guess_rad)
        angles = sqp.solve(problem, self._bounds, guess).rollout.angles
        self._plan_rad = sqp.feasible(self._bounds, commanded_rad, angles)
        predicted_mm = self._model.tip_mm(self._plan_rad) + self.disturbance_mm
        return Plan(self._plan_rad[0], predicted_mm)

    def _reachable_from(self, index: float) -> Array:
        return np.array([self.path.reachable_rad(index + k) for k in self._ahead])
