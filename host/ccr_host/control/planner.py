"""What solves (15) step after step, and keeps its plan as the start of the next solution."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.control import warm_start
from ccr_host.control.nlp import Angles, Rollout, Tracking, Weights
from ccr_host.control.sqp import Bounds, solve
from ccr_host.core.plugins import import_optional
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference

FloatArray = NDArray[np.float64]


class Plan(NamedTuple):
    """The steps ahead, M of them."""

    angles_rad: FloatArray
    """(M, 2), within the motor limits."""
    predicted_mm: FloatArray
    """(M, 3): the tip at the end of each."""
    iterations: int
    converged: bool


class Planner(Protocol):
    """Plans along one reference."""

    def begin(self, reference: Reference) -> FloatArray:
        """Take over a reference; the reachable angles of its first sample, (2,)."""
        ...

    def plan(self, now: int, commanded_rad: tuple[float, float], position_mm: FloatArray) -> Plan:
        """Plan steps ``now`` and following, as far as horizon and path go, at least one.

        Args:
            now: index of the step to command.
            commanded_rad: angles commanded last, within the motor limits.
            position_mm: (3,), the tip.

        Raises:
            SolverError: there is no solution; says why.
        """
        ...

    def interrupt(self, q_rad: FloatArray) -> None:
        """Forget the plan: ``q_rad`` (2,) was commanded instead."""
        ...


class SqpPlanner:
    """By ``control.sqp``, in Python and DAQP."""

    def __init__(self, description: Description, model: ConstantCurvature, bounds: Bounds) -> None:
        control = description.control
        self._model, self._bounds = model, bounds
        self._weights = Weights(control.position_weight, control.effort_weight)
        self._live_steps = control.horizon - 1
        self._angles: Angles = []
        self._expected_mm: FloatArray | None = None

    def begin(self, reference: Reference) -> FloatArray:
        self._target_mm = reference.target_mm
        self._reachable: Angles = [self._bounds.clip((a, b)) for a, b in reference.q_rad.tolist()]
        first = np.array(self._reachable[0])
        self.interrupt(first)
        return first

    def plan(self, now: int, commanded_rad: tuple[float, float], position_mm: FloatArray) -> Plan:
        targets_mm = self._target_mm[now : now + self._live_steps]
        problem = Tracking.of(self._model, self._weights, commanded_rad, position_mm, targets_mm)
        guess = warm_start.shift(self._angles, self._reachable, now, len(targets_mm))
        if self._expected_mm is not None:
            guess = warm_start.correct(guess, problem, position_mm, self._expected_mm)
        solution = solve(problem, self._bounds, self._bounds.feasible(commanded_rad, guess))
        predicted_mm = _predicted(targets_mm, solution.rollout)
        self._angles = solution.rollout.angles
        self._expected_mm = predicted_mm[0]
        # The QP solver meets its bounds to 1e-6 rad only.
        inside = np.array([self._bounds.clip(angles) for angles in self._angles])
        return Plan(inside, predicted_mm, solution.iterations, solution.converged)

    def interrupt(self, q_rad: FloatArray) -> None:
        first, second = q_rad.tolist()
        self._angles = [(first, second)]
        self._expected_mm = None


def make_planner(description: Description, model: ConstantCurvature, bounds: Bounds) -> Planner:
    """The planner that ``control.solver`` names.

    Raises:
        ConfigError: it needs an extra that is not installed.
    """
    if description.control.solver == "compiled":
        import_optional("numba", "fast", "control.solver = compiled")
        from ccr_host.control.compiled.planner import CompiledPlanner  # noqa: PLC0415 - optional

        return CompiledPlanner(description, model, bounds)
    return SqpPlanner(description, model, bounds)


def _predicted(targets_mm: FloatArray, rollout: Rollout) -> FloatArray:
    """Targets plus predicted errors, (M, 3)."""
    errors = [
        (across, -sagittal.real, sagittal.imag)
        for across, sagittal in zip(rollout.error_across_mm, rollout.error_sagittal_mm, strict=True)
    ]
    predicted: FloatArray = targets_mm + np.array(errors)
    return predicted
