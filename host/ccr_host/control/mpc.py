"""Algorithm 1 of the paper: model predictive control with optical feedback."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.planner import make_planner
from ccr_host.control.sqp import Bounds, SolverError
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]


class ModelPredictive:
    """The paper's MPC: horizon shrinking at the end of the path, first increment applied.

    Beside (15)'s bound on each increment the motor limits hold for every planned angle. Without a
    measurement it predicts from the model and the error last seen between model and measurement.
    Where no solution can be had it repeats the last command.
    """

    name = "mpc"

    def __init__(self, description: Description) -> None:
        limits = MotorLimits.of(description.servo)
        self._model = ConstantCurvature(description.robot)
        self._bounds = Bounds(
            limits.lower_rad, limits.upper_rad, description.control.step_bound_rad
        )
        self._planner = make_planner(description, self._model, self._bounds)

    def start(self, reference: Reference) -> Command:
        """The nearest reachable configuration of the first sample."""
        self._steps = len(reference)
        self._last_rad = self._planner.begin(reference)
        self.plan_rad = self._last_rad[None, :]
        """All angles planned by the last step, (M, 2)."""
        self._last_seen: tuple[FloatArray, tuple[float, float]] | None = None
        predicted_mm = self._model.jet_at(*self._last_rad.tolist()).tip_mm[None, :]
        return Command(self._last_rad.copy(), predicted_mm, Outcome.SOLVED)

    def step(self, observation: Observation) -> Command:
        """Measurement in, command out; never raises on bad measurements."""
        first, second = observation.q_rad.tolist()
        if not (math.isfinite(first) and math.isfinite(second)):
            return self._hold("the angles commanded last are not finite")
        tip_mm = observation.tip_mm
        if tip_mm is not None and not all(map(math.isfinite, tip_mm.tolist())):
            return self._hold("the measured position is not finite")
        if not observation.step < self._steps:
            return self._hold("the path is over")
        commanded = self._bounds.clip((first, second))
        position_mm, outcome = self._position(tip_mm, commanded)
        try:
            plan = self._planner.plan(observation.step, commanded, position_mm)
        except SolverError as error:
            return self._hold(str(error))
        self.plan_rad = plan.angles_rad
        self._last_rad = plan.angles_rad[0]
        detail = "" if plan.converged else f"stopped after {plan.iterations} iterations"
        return Command(
            self._last_rad.copy(), plan.predicted_mm, outcome, detail, iterations=plan.iterations
        )

    def _position(
        self, tip_mm: FloatArray | None, commanded: tuple[float, float]
    ) -> tuple[FloatArray, Outcome]:
        if tip_mm is not None:
            self._last_seen = tip_mm, commanded
            return tip_mm, Outcome.SOLVED
        position_mm = self._model.jet_at(*commanded).tip_mm
        if self._last_seen is not None:
            seen_mm, then = self._last_seen
            position_mm = position_mm + seen_mm - self._model.jet_at(*then).tip_mm
        return position_mm, Outcome.COASTED

    def _hold(self, why: str) -> Command:
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        return Command(self._last_rad.copy(), np.empty((0, 3)), Outcome.HELD, why)
