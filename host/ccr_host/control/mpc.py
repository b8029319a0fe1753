"""Algorithm 1 of the paper: model predictive control with optical feedback."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Description
from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.nlp import Angles, Rollout, Tracking, Weights
from ccr_host.control.sqp import Bounds, SolverError, solve
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
        control = description.control
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)
        self._weights = Weights(control.position_weight, control.effort_weight)
        self._bounds = Bounds(
            self._limits.lower_rad, self._limits.upper_rad, control.step_bound_rad
        )
        self._live_steps = control.horizon - 1

    def start(self, reference: Reference) -> Command:
        """The nearest reachable configuration of the first sample."""
        self._reference = reference
        self._reachable = [self._bounds.clip((a, b)) for a, b in reference.q_rad.tolist()]
        self.plan_rad = self._reachable[:1]
        self._last_seen: tuple[FloatArray, tuple[float, float]] | None = None
        self._last = self.plan_rad[0]
        predicted_mm = self._model.jet_at(*self._last).tip_mm[None, :]
        self._expected_mm: FloatArray | None = None
        return Command(np.array(self._last), predicted_mm, Outcome.SOLVED)

    def step(self, observation: Observation) -> Command:
        """Measurement in, command out; never raises on bad measurements."""
        first, second = observation.q_rad.tolist()
        if not (math.isfinite(first) and math.isfinite(second)):
            return self._hold("the angles commanded last are not finite")
        tip_mm = observation.tip_mm
        if tip_mm is not None and not all(map(math.isfinite, tip_mm.tolist())):
            return self._hold("the measured position is not finite")
        commanded = self._bounds.clip((first, second))
        position_mm, outcome = self._position(tip_mm, commanded)
        now = observation.step
        targets_mm = self._reference.target_mm[now : now + self._live_steps]
        if not len(targets_mm):
            return self._hold("the path is over")
        problem = Tracking.of(self._model, self._weights, commanded, position_mm, targets_mm)
        plan = self._shifted_plan(now, len(targets_mm))
        guess = self._bounds.feasible(commanded, self._corrected(plan, problem, position_mm))
        try:
            solution = solve(problem, self._bounds, guess)
        except SolverError as error:
            return self._hold(str(error))
        self.plan_rad = solution.rollout.angles
        # The QP solver meets its bounds to 1e-6 rad only.
        self._last = self._bounds.clip(self.plan_rad[0])
        detail = "" if solution.converged else f"stopped after {solution.iterations} iterations"
        predicted_mm = _predicted(targets_mm, solution.rollout)
        self._expected_mm = predicted_mm[0]
        return Command(np.array(self._last), predicted_mm, outcome, detail)

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

    def _shifted_plan(self, now: int, steps: int) -> Angles:
        """The last plan without its first step, continued as the reachable path goes on."""
        plan = self.plan_rad[1 : 1 + steps]
        last = plan[-1] if plan else self.plan_rad[-1]
        for step in range(now + len(plan), now + steps):
            before, after = self._reachable[step - 1], self._reachable[step]
            last = last[0] + after[0] - before[0], last[1] + after[1] - before[1]
            plan.append(last)
        return plan

    def _corrected(self, plan: Angles, problem: Tracking, position_mm: FloatArray) -> Angles:
        """The plan, moved against what the measurement shows beyond the prediction.

        One damped least-squares step through J for the whole plan; it saves the solver about
        one iteration in three.
        """
        if self._expected_mm is None:
            return plan
        x, y, z = (position_mm - self._expected_mm).tolist()
        jet = problem.start_jet
        sagittal = complex(-y, -z)
        slope_1 = (sagittal * jet.sagittal_1).real
        slope_2 = (sagittal * jet.sagittal_2).real + x * jet.across_2
        damping = self._weights.effort / self._weights.position
        gram_11 = abs(jet.sagittal_1) ** 2 + damping
        gram_12 = (jet.sagittal_1 * jet.sagittal_2.conjugate()).real
        gram_22 = abs(jet.sagittal_2) ** 2 + jet.across_2**2 + damping
        determinant = gram_11 * gram_22 - gram_12 * gram_12
        if not determinant > 0.0:
            return plan
        back_1 = (gram_22 * slope_1 - gram_12 * slope_2) / determinant
        back_2 = (gram_11 * slope_2 - gram_12 * slope_1) / determinant
        return [(angle_1 - back_1, angle_2 - back_2) for angle_1, angle_2 in plan]

    def _hold(self, why: str) -> Command:
        self.plan_rad = [self._last]
        self._expected_mm = None
        return Command(np.array(self._last), np.empty((0, 3)), Outcome.HELD, why)


def _predicted(targets_mm: FloatArray, rollout: Rollout) -> FloatArray:
    """Targets plus predicted errors, (M, 3)."""
    errors = [
        (across, -sagittal.real, sagittal.imag)
        for across, sagittal in zip(rollout.error_across_mm, rollout.error_sagittal_mm, strict=True)
    ]
    predicted: FloatArray = targets_mm + np.array(errors)
    return predicted
