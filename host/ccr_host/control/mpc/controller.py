"""Algorithm 1 of the paper: model predictive control with optical feedback."""

from __future__ import annotations

import numpy as np

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.bending import pose_estimate
from ccr_host.control.mpc.plan import Planner, Settings
from ccr_host.control.mpc.problem import Constants, Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

_FAILURES = {
    sqp.COST_NOT_FINITE: "the cost is not finite",
    sqp.HESSIAN_NOT_CONVEX: "the Hessian is not positive definite",
    sqp.QP_FAILED: "the QP has no finite solution",
}


class ModelPredictive:
    """The paper's MPC: the horizon shrinks at the end of the path, the first increment is applied.

    In addition to (15)'s bound on each increment, every planned angle respects the motor limits.
    Without a measurement it predicts from the model and the last error between model and
    measurement. Without a solution it repeats the last command.

    Raises:
        ConfigError: the solver needs an extra that is not installed.
    """

    name = "mpc"
    shortest_period_s = 0.2
    """At shorter ones the delays of camera and servos, which (14) leaves out, let the paper's robot
    swing or run away, see docs/control-baselines.md."""

    def __init__(self, description: Description) -> None:
        control, model = description.control, ConstantCurvature(description.robot)
        self._model, self._limits = model, MotorLimits.of(description.servo)
        bounds = Bounds.of(self._limits, control.step_bound_rad)
        self._live_steps = control.horizon - 1
        weights = Weights.of(description.robot, control.position_weight, control.effort_weight)
        settings = Settings(Constants.of(description.robot, weights), bounds)
        self._planner = Planner(settings, control.solver)
        self._robot = description.robot

    def start(self, reference: Reference) -> Command:
        """Return the nearest reachable configuration of the first sample."""
        self._steps = len(reference)
        reachable_rad = self._limits.clip(reference.q_rad)
        self._planner.begin(np.hstack([reference.target_mm, reachable_rad]))
        self._last_rad = reachable_rad[0].copy()
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        """The angles planned by the last step, (M, n)."""
        self._estimate = pose_estimate(self._robot)
        predicted_mm = self._model.tip_mm(self._last_rad)[None, :]
        return Command(self._last_rad.copy(), predicted_mm, Outcome.SOLVED)

    def step(self, observation: Observation) -> Command:
        """Return the command for a measurement; never raises on bad measurements."""
        tip_mm = observation.tip_mm
        if not np.isfinite(observation.q_rad).all():
            return self._hold("the angles commanded last are not finite")
        if tip_mm is not None and not np.isfinite(tip_mm).all():
            return self._hold("the measured position is not finite")
        if not observation.step < self._steps:
            return self._hold("the path is over")
        commanded_rad = self._limits.clip(observation.q_rad)
        outcome = Outcome.COASTED if tip_mm is None else Outcome.SOLVED
        steps = min(self._live_steps, self._steps - observation.step)
        # A wild measurement costs infinitely much, which is no solution.
        with np.errstate(over="ignore", invalid="ignore"):
            pose = self._estimate.pose(observation, commanded_rad)
            status, iterations, plan = self._planner.plan(
                observation.step, steps, commanded_rad, *pose
            )
        if status in _FAILURES:
            return self._hold(_FAILURES[status])
        self.plan_rad = plan[:, :-3]
        self._last_rad = plan[0, :-3]
        detail = "" if status == sqp.CONVERGED else f"stopped after {iterations} iterations"
        return Command(self._last_rad.copy(), plan[:, -3:], outcome, detail, iterations=iterations)

    def _hold(self, why: str) -> Command:
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        return Command(self._last_rad.copy(), np.empty((0, 3)), Outcome.HELD, why)
