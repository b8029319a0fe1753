"""Visual servoing on an estimated Jacobian; the robot's model is only its first guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.shell import NOTHING_MM, Law, Measurement, PathView, Plan, believable
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]


def damped_inverse(jacobian: FloatArray, damping: float) -> FloatArray:
    """(J'J + damping^2 I)^-1 J', (n, 3) of a (3, n) Jacobian; finite for any damping above 0."""
    gram = jacobian.T @ jacobian + damping**2 * np.eye(jacobian.shape[1])
    return np.asarray(np.linalg.solve(gram, jacobian.T))


class JacobianEstimator(Protocol):
    """Estimates J, (3, n) in mm/rad, from secants."""

    jacobian_mm_rad: FloatArray

    def start(self, guess_mm_rad: FloatArray) -> None:
        """Reset the estimate to a first guess."""
        ...

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        """Process a secant: turn of the motors, (n,), not zero, and move of the tip, (3,)."""
        ...


@dataclass(frozen=True)
class Tuning:
    """Tuning common to both estimators; docs/control-baselines.md describes how it was found."""

    integral_time_s: float = 0.06
    """An error seen for T is corrected by the share T / (T + this): 0.94 at 1 Hz, 0.45 at 20 Hz."""
    damping_mm: float = 20.0
    """Damping of the inverse, mm/rad; singular values are about 100 away from the folds."""
    longest_move_rad: float = 0.3
    """Limit of one command: two or three of the paper's longest steps at 1 Hz."""
    fastest_rad_s: float = 1.0
    """Five times the fastest rate of the paths; a vanishing J would demand any rate."""
    motion_threshold_rad: float = 0.03
    """Shorter motions, 3 mm of the tip, are not informative at 0.25 mm of noise."""


class JacobianFeedback(Law):
    """q += J^+ (path's step + part of the error), with damped J^+ and J estimated during motion."""

    def __init__(self, description: Description, estimator: JacobianEstimator) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)
        self._estimator = estimator
        self._tuning = Tuning()

    def start(self, path: PathView, history: SetpointHistory) -> None:
        """Begin a path with the model's J at the first point."""
        super().start(path, history)
        self._estimator.start(self._model.jacobian_mm_rad(path.reachable_rad(0.0)))
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
        share = measurement.elapsed_s / (measurement.elapsed_s + self._tuning.integral_time_s)
        self._correction_mm = self._correction_mm + share * error_mm

    def plan(self, index: float, commanded_rad: FloatArray, time_s: float) -> Plan:
        """Plan an increment; what the limits cut off is discarded."""
        tuning = self._tuning
        target_mm = self.path.target_mm(index)
        wanted_mm = target_mm - self._target_mm + self._correction_mm
        self._target_mm, self._correction_mm = target_mm, np.zeros(3)
        jacobian = self._estimator.jacobian_mm_rad
        turn_rad = damped_inverse(jacobian, tuning.damping_mm) @ wanted_mm
        longest_rad = min(tuning.longest_move_rad, tuning.fastest_rad_s * self._elapsed_s)
        turn_rad = turn_rad * min(1.0, longest_rad / max(float(np.abs(turn_rad).max()), 1e-9))
        q_rad = self._limits.clip(commanded_rad + turn_rad)
        if self._newest is None:
            return Plan(q_rad, NOTHING_MM)
        moved_mm = jacobian @ (q_rad - self._newest.setpoint_rad)
        return Plan(q_rad, (self._newest.tip_mm + moved_mm)[None])

    def _learn(self, measurement: Measurement) -> None:
        if self._anchor is not None:
            turn_rad = measurement.setpoint_rad - self._anchor.setpoint_rad
            if float(np.linalg.norm(turn_rad)) < self._tuning.motion_threshold_rad:
                return
            self._estimator.correct(turn_rad, measurement.tip_mm - self._anchor.tip_mm)
        self._anchor = measurement


class BroydenEstimator:
    """J += rate (dx - J dq) dq' / (dq'dq + regularisation^2).

    As in uncalibrated visual servoing (Jagersand, Fuentes, Nelson, ICRA 1997); the least change of
    J that explains a motion, as Yip and Camarillo estimate it (IEEE T-RO 30(4), 2014), is Broyden's
    update as long as no constraint is active.

    Args:
        rate: 1 fits the newest secant, a lower rate averages several.
        regularisation_rad: turns well below this change J little.
    """

    jacobian_mm_rad: FloatArray

    def __init__(self, rate: float = 0.5, regularisation_rad: float = 0.03) -> None:
        self._rate = rate
        self._regularisation_rad = regularisation_rad

    def start(self, guess_mm_rad: FloatArray) -> None:
        self.jacobian_mm_rad = guess_mm_rad

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        residual_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        weight = self._rate / (turn_rad @ turn_rad + self._regularisation_rad**2)
        self.jacobian_mm_rad = self.jacobian_mm_rad + weight * np.outer(residual_mm, turn_rad)


class KalmanEstimator:
    """Kalman filter whose state is the entries of J.

    As in model-free control of continuum robots (Li, Kang, Branson, Dai, IEEE/ASME T-Mech 23(1),
    2018): the entries follow random walks, each motion dx = J dq + noise measures them. The
    rows of J share one covariance, (n, n): their regressors and noises are the same.

    Args:
        deviation_mm_rad: standard deviation of the first guess.
        walk_mm_rad: random walk of an entry per square root of a radian turned.
        noise_mm: noise of a measured motion, including nonlinearity.
    """

    jacobian_mm_rad: FloatArray

    def __init__(
        self, deviation_mm_rad: float = 40.0, walk_mm_rad: float = 15.0, noise_mm: float = 1.5
    ) -> None:
        self._deviation_mm_rad = deviation_mm_rad
        self._walk_mm_rad = walk_mm_rad
        self._noise_mm = noise_mm

    def start(self, guess_mm_rad: FloatArray) -> None:
        self.jacobian_mm_rad = guess_mm_rad
        self._covariance = self._deviation_mm_rad**2 * np.eye(guess_mm_rad.shape[1])

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        turned_rad = float(np.linalg.norm(turn_rad))
        walk = self._walk_mm_rad**2 * turned_rad * np.eye(len(turn_rad))
        covariance = self._covariance + walk
        variance_mm2 = turn_rad @ covariance @ turn_rad + self._noise_mm**2
        gain = covariance @ turn_rad / variance_mm2
        innovation_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        self.jacobian_mm_rad = self.jacobian_mm_rad + np.outer(innovation_mm, gain)
        self._covariance = covariance - variance_mm2 * np.outer(gain, gain)


class Broyden(JacobianFeedback):
    """Visual servoing with Broyden's rank-one update."""

    name = "broyden"

    def __init__(self, description: Description) -> None:
        super().__init__(description, BroydenEstimator())


class KalmanJacobian(JacobianFeedback):
    """Visual servoing with a Kalman filter."""

    name = "kalman-jacobian"

    def __init__(self, description: Description) -> None:
        super().__init__(description, KalmanEstimator())
