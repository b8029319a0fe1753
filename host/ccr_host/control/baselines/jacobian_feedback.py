"""Visual servoing on an estimated Jacobian: no model of the robot after the first guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.baselines.damped_inverse import damped_inverse
from ccr_host.control.baselines.law import LONGEST_ERROR_MM, PathView, Plan, Sight, shortened
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]


class JacobianEstimator(Protocol):
    """Learns J, (3, 2) in mm/rad, from secants."""

    jacobian_mm_rad: FloatArray

    def start(self, guess_mm_rad: FloatArray) -> None:
        """Forget everything but a first guess."""
        ...

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        """The motors turned by (2,), not zero, and the tip moved by (3,)."""
        ...


@dataclass(frozen=True)
class Tuning:
    """The same for both estimators; docs/control-baselines.md tells how it was found."""

    integral_time_s: float = 0.06
    """An error seen for T is taken up by T / (T + this): 0.94 at 1 Hz, 0.45 at 20 Hz."""
    damping_mm: float = 20.0
    """Per rad of motor, of the inverse; singular values are about 100 away from the folds."""
    longest_move_rad: float = 0.3
    """In one command: two or three of the paper's longest steps at 1 Hz."""
    fastest_rad_s: float = 1.0
    """Five times the paths' fastest; a J gone to zero asks for any rate."""
    motion_threshold_rad: float = 0.03
    """Less motion than this, 3 mm of tip, tells little beside 0.25 mm of noise."""


class JacobianFeedback:
    """q += J^+ (path's step + share of the error), J^+ damped, J estimated as the robot moves."""

    def __init__(
        self, description: Description, estimator: JacobianEstimator, tuning: Tuning
    ) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)
        self._estimator = estimator
        self._tuning = tuning

    def start(self, path: PathView) -> None:
        """The first guess of J is the model's at the first point."""
        self._path = path
        self._estimator.start(self._model.jacobian_mm_rad(path.reachable_rad(0.0)))
        self._newest: Sight | None = None
        self._elapsed_s = path.period_s
        self._anchor: Sight | None = None
        self._target_mm = path.target_mm(0.0)
        self._correction_mm = np.zeros(3)

    def observe(self, sight: Sight) -> None:
        """A secant since the last one, once the motors have turned far enough; the error."""
        self._newest = sight
        self._elapsed_s = sight.elapsed_s
        self._learn(sight)
        if sight.index is None:
            return
        error_mm = shortened(self._path.target_mm(sight.index) - sight.tip_mm, LONGEST_ERROR_MM)
        share = sight.elapsed_s / (sight.elapsed_s + self._tuning.integral_time_s)
        self._correction_mm = self._correction_mm + share * error_mm

    def plan(self, index: float, commanded_rad: FloatArray) -> Plan:
        """One increment; where the limits stop it nothing is kept for later."""
        tuning = self._tuning
        target_mm = self._path.target_mm(index)
        wanted_mm = target_mm - self._target_mm + self._correction_mm
        self._target_mm, self._correction_mm = target_mm, np.zeros(3)
        jacobian = self._estimator.jacobian_mm_rad
        turn_rad = damped_inverse(jacobian, tuning.damping_mm) @ wanted_mm
        longest_rad = min(tuning.longest_move_rad, tuning.fastest_rad_s * self._elapsed_s)
        turn_rad = turn_rad * min(1.0, longest_rad / max(float(np.abs(turn_rad).max()), 1e-9))
        q_rad = self._limits.clip(commanded_rad + turn_rad)
        if self._newest is None:
            return Plan(q_rad, np.empty((0, 3)))
        moved_mm = jacobian @ (q_rad - self._newest.setpoint_rad)
        return Plan(q_rad, (self._newest.tip_mm + moved_mm)[None])

    def _learn(self, sight: Sight) -> None:
        if self._anchor is not None:
            turn_rad = sight.setpoint_rad - self._anchor.setpoint_rad
            if float(np.linalg.norm(turn_rad)) < self._tuning.motion_threshold_rad:
                return
            self._estimator.correct(turn_rad, sight.tip_mm - self._anchor.tip_mm)
        self._anchor = sight
