"""A complete step of the MPC, from measurement to plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.problem import Pair, Rows, Tracking, Weights, roll_out, tracking
from ccr_host.control.mpc.qp import OPTIMAL, minimise
from ccr_host.control.mpc.sqp import Bounds, Newton, Solution
from ccr_host.control.mpc.two_motors import Geometry
from ccr_host.core.plugins import import_optional

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]

StepResult = tuple[int, int, float, FloatArray]
"""Status, iterations and blend, see ``sqp.Solution``; the plan (M, 5), angles (rad) and predicted
tip (mm) of each step."""


class Settings(NamedTuple):
    """The constants of a run."""

    geometry: Geometry
    bounds: Bounds
    weights: Weights


def plan_step(
    settings: Settings,
    path: Rows,
    last_plan: Rows,
    now: int,
    steps: int,
    commanded_rad: Pair,
    position_mm: Triple,
    program: FloatArray,
) -> StepResult:
    """Plan ahead from one measurement.

    Args:
        settings: constants of the run.
        path: (T, 5), target (mm) and nearest reachable angles (rad) of each step.
        last_plan: (k, 5), as returned, or NaN for the tip where none was predicted.
        now: index of the step to command.
        steps: M, at most T - now, at least 1.
        commanded_rad: last command, within the limits.
        position_mm: measured tip.
        program: see ``sqp.solve``.
    """
    targets_mm = path[now : now + steps]
    problem = tracking(settings.geometry, settings.weights, commanded_rad, position_mm, targets_mm)
    guess = shift(last_plan, path, now, steps)
    if not math.isnan(last_plan[0][2]):
        guess = correct(guess, problem, position_mm, last_plan[0])
    guess = sqp.feasible(settings.bounds, commanded_rad, guess)
    solution = sqp.solve(problem, settings.bounds, guess, program)
    return _result(problem, settings.bounds, targets_mm, solution)


def resume(
    settings: Settings,
    targets_mm: Rows,
    plan: FloatArray,
    commanded_rad: Pair,
    position_mm: Triple,
    program: FloatArray,
    newton: tuple[FloatArray, float, float],
    iteration: int,
) -> StepResult:
    """Continue after NEEDS_QP, from its plan with the ``sqp.Newton`` of its iteration."""
    problem = tracking(settings.geometry, settings.weights, commanded_rad, position_mm, targets_mm)
    rollout = roll_out(problem, [(row[0], row[1]) for row in plan])
    is_over, rollout = sqp.line_search(problem, rollout, Newton(newton[0], newton[1], newton[2]))
    solution = Solution(sqp.CONVERGED, iteration, rollout, 1.0)
    if not is_over:
        solution = sqp.descend(problem, settings.bounds, rollout, iteration + 1, program)
    return _result(problem, settings.bounds, targets_mm, solution)


def shift(last_plan: Rows, path: Rows, now: int, steps: int) -> list[Pair]:
    """The last plan without its first step, extended along the reachable path."""
    guess = [(row[0], row[1]) for row in last_plan[1 : 1 + steps]]
    first, second = guess[-1] if len(guess) > 0 else (last_plan[-1][0], last_plan[-1][1])
    for j in range(now + len(guess), now + steps):
        before, after = path[j - 1], path[j]
        first, second = first + after[3] - before[3], second + after[4] - before[4]
        guess.append((first, second))
    return guess


def correct(
    guess: list[Pair],
    problem: Tracking,
    position_mm: Triple,
    expected: Sequence[float] | FloatArray,
) -> list[Pair]:
    """The guess, corrected for the difference of measurement and prediction.

    ``expected`` is the row of the plan that predicts the tip measured as ``position_mm``. A single
    damped least-squares step through J for the whole plan saves about a third of the iterations.
    """
    jet = problem.start_jet
    x = position_mm[0] - expected[2]
    sagittal = complex(expected[3] - position_mm[1], expected[4] - position_mm[2])
    slope_1 = (sagittal * jet.sagittal_1).real
    slope_2 = (sagittal * jet.sagittal_2).real + x * jet.across_2
    damping = problem.weights.effort / problem.weights.position
    gram_11 = abs(jet.sagittal_1) ** 2 + damping
    gram_12 = (jet.sagittal_1 * jet.sagittal_2.conjugate()).real
    gram_22 = abs(jet.sagittal_2) ** 2 + jet.across_2**2 + damping
    determinant = gram_11 * gram_22 - gram_12 * gram_12
    if not determinant > 0.0:
        return guess
    back_1 = (gram_22 * slope_1 - gram_12 * slope_2) / determinant
    back_2 = (gram_11 * slope_2 - gram_12 * slope_1) / determinant
    return [(angle_1 - back_1, angle_2 - back_2) for angle_1, angle_2 in guess]


def _result(problem: Tracking, bounds: Bounds, targets_mm: Rows, solution: Solution) -> StepResult:
    stages, angles = solution.rollout.stages, solution.rollout.angles
    if solution.status != sqp.NEEDS_QP:
        # DAQP satisfies its bounds only to 1e-6 rad.
        angles = sqp.feasible(bounds, problem.start_rad, angles)
    plan = np.empty((len(angles), 5))
    for j in range(len(angles)):
        _, _, across, sagittal = stages[j]
        plan[j, 0], plan[j, 1] = angles[j]
        plan[j, 2] = targets_mm[j][0] + across
        plan[j, 3] = targets_mm[j][1] - sagittal.real
        plan[j, 4] = targets_mm[j][2] + sagittal.imag
    return solution.status, solution.iterations, solution.blend, plan


class Code(NamedTuple):
    """``plan_step`` and ``resume``, plain or compiled."""

    settings: Any
    """The first argument of both."""
    plan_step: Callable[..., StepResult]
    resume: Callable[..., StepResult]
    rows: Callable[[FloatArray], Any]
    """Converts an array to the type that they require."""


class Planner:
    """Plans the steps of a path, plain or compiled as ``solver`` of the description says.

    Raises:
        ConfigError: the solver needs an extra that is not installed.
    """

    def __init__(self, settings: Settings, solver: str) -> None:
        self._bounds = settings.bounds
        self._program = np.empty((1, 0))
        # Reading numbers from lists is many times faster than from arrays.
        code = Code(settings, plan_step, resume, np.ndarray.tolist)
        if solver == "compiled":
            import_optional("numba", "fast", "control.solver = compiled")
            from ccr_host.control.mpc.compiled import compiled_code  # noqa: PLC0415 - optional

            code = compiled_code(settings)
        self._code = code

    def begin(self, path: FloatArray) -> None:
        """Begin a path (T, 5), see ``plan_step``."""
        self._path = self._code.rows(path)

    def interrupt(self, q_rad: FloatArray) -> None:
        """Discard the plan, as ``q_rad`` (2,) was commanded instead."""
        row = np.concatenate([q_rad, np.full(3, math.nan)])
        self._last_plan = self._code.rows(row[None, :])

    def plan(
        self, now: int, steps: int, commanded_rad: Pair, position_mm: Triple
    ) -> tuple[int, int, FloatArray]:
        """Make a ``plan_step`` from the last plan; returns status, iterations and plan."""
        code, path = self._code, self._path
        n = 2 * steps
        if self._program.shape[1] != n:
            self._program = np.empty((n + 1, n))
        program = self._program
        result = code.plan_step(
            code.settings, path, self._last_plan, now, steps, commanded_rad, position_mm, program
        )
        while result[0] == sqp.NEEDS_QP:
            _, iteration, blend, plan = result
            lower, upper = sqp.room(self._bounds, commanded_rad, plan[:, :2].tolist())
            status, step, minimum = minimise(program[:n], program[n], lower, upper)
            if status != OPTIMAL:
                plan[:, :2] = sqp.feasible(self._bounds, commanded_rad, plan[:, :2].tolist())
                result = sqp.QP_FAILED if iteration == 1 else sqp.STOPPED, iteration, blend, plan
                break
            result = code.resume(
                code.settings,
                path[now : now + steps],
                plan,
                commanded_rad,
                position_mm,
                program,
                (np.array(step), -minimum, blend),
                iteration,
            )
        status, iterations, _, plan = result
        self._last_plan = code.rows(plan)
        return status, iterations, plan
