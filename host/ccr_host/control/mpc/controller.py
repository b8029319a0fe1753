"""Algorithm 1 of the paper: model predictive control with optical feedback."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.plan import Planner, Settings
from ccr_host.control.mpc.problem import Pair, Weights
from ccr_host.control.mpc.sqp import Bounds, clip
from ccr_host.control.mpc.two_motors import Geometry
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]

_FAILURES = {
    sqp.COST_NOT_FINITE: "the cost is not finite",
    sqp.HESSIAN_NOT_CONVEX: "the Hessian is not positive definite",
    sqp.QP_FAILED: "the QP has no finite solution",
}


def geometry_of(robot: Robot) -> Geometry:
    """What the jets need of a robot.

    Raises:
        ConfigError: the robot has segments of its own.
    """
    if robot.segments:
        raise ConfigError(
            "mpc and mpc-offset know only robots of two planar segments with a motor each",
            "choose another controller, or describe the robot without [[robot.segments]]",
        )
    length_1, length_2 = robot.segment_lengths_mm
    gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    return Geometry((length_1, length_2), robot.marker_offset_mm, gain)


class ModelPredictive:
    """The paper's MPC: the horizon shrinks at the end of the path, the first increment is applied.

    In addition to (15)'s bound on each increment, every planned angle respects the motor limits.
    Without a measurement it predicts from the model and the last error between model and
    measurement. Without a solution it repeats the last command.

    Raises:
        ConfigError: the solver needs an extra that is not installed, or see ``geometry_of``.
    """

    name = "mpc"

    def __init__(self, description: Description) -> None:
        control, limits = description.control, MotorLimits.of(description.servo)
        self._model = ConstantCurvature(description.robot)
        self._bounds = Bounds.of(limits, control.step_bound_rad)
        weights = Weights(control.position_weight, control.effort_weight)
        self._live_steps = control.horizon - 1
        settings = Settings(geometry_of(description.robot), self._bounds, weights)
        self._planner = Planner(settings, control.solver)

    def start(self, reference: Reference) -> Command:
        """Return the nearest reachable configuration of the first sample."""
        self._steps = len(reference)
        reachable_rad = np.clip(reference.q_rad, self._bounds.lower_rad, self._bounds.upper_rad)
        self._planner.begin(np.hstack([reference.target_mm, reachable_rad]))
        self._last_rad = reachable_rad[0].copy()
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        """The angles planned by the last step, (M, 2)."""
        self._last_seen: tuple[FloatArray, Pair] | None = None
        predicted_mm = self._model.tip_mm(self._last_rad)[None, :]
        return Command(self._last_rad.copy(), predicted_mm, Outcome.SOLVED)

    def step(self, observation: Observation) -> Command:
        """Return the command for a measurement; never raises on bad measurements."""
        first, second = observation.q_rad.tolist()
        if not (math.isfinite(first) and math.isfinite(second)):
            return self._hold("the angles commanded last are not finite")
        tip_mm = observation.tip_mm
        if tip_mm is not None and not all(map(math.isfinite, tip_mm.tolist())):
            return self._hold("the measured position is not finite")
        if not observation.step < self._steps:
            return self._hold("the path is over")
        commanded = clip(self._bounds, (first, second))
        position_mm, outcome = self._position(tip_mm, commanded)
        steps = min(self._live_steps, self._steps - observation.step)
        x, y, z = position_mm.tolist()
        status, iterations, plan = self._planner.plan(observation.step, steps, commanded, (x, y, z))
        if status in _FAILURES:
            return self._hold(_FAILURES[status])
        self.plan_rad = plan[:, :2]
        self._last_rad = plan[0, :2]
        detail = "" if status == sqp.CONVERGED else f"stopped after {iterations} iterations"
        return Command(self._last_rad.copy(), plan[:, 2:], outcome, detail, iterations=iterations)

    def _position(self, tip_mm: FloatArray | None, commanded: Pair) -> tuple[FloatArray, Outcome]:
        if tip_mm is not None:
            self._last_seen = tip_mm, commanded
            return tip_mm, Outcome.SOLVED
        position_mm = self._model.tip_mm(commanded)
        if self._last_seen is not None:
            seen_mm, then = self._last_seen
            position_mm = position_mm + seen_mm - self._model.tip_mm(then)
        return position_mm, Outcome.COASTED

    def _hold(self, why: str) -> Command:
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        return Command(self._last_rad.copy(), np.empty((0, 3)), Outcome.HELD, why)
