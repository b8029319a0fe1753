"""A complete step of the MPC, from measurement to plan."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.problem import Constants, Tracking, free_moves_rad, squared
from ccr_host.control.mpc.qp import solved
from ccr_host.control.mpc.sqp import Bounds, Solution
from ccr_host.core.arrays import Array
from ccr_host.core.plugins import import_optional
from ccr_host.robot.kinematics import jets, products

StepResult = tuple[int, int, Array]
"""Status and iterations, see ``sqp.Solution``; the plan (M, n + 3), angles (rad) and predicted tip
(mm) of each step."""

_LEAST_DAMPING = 1e-10
"""Least damping over the trace of J'J; decides if R is 0 and J has less rank than motors."""


class Settings(NamedTuple):
    """The constants of a run."""

    constants: Constants
    bounds: Bounds


def plan_step(
    settings: Settings,
    path: Array,
    last_plan: Array,
    now: int,
    steps: int,
    commanded_rad: Array,
    position_mm: Array,
    extra_rad: Array,
) -> StepResult:
    """Plan ahead from one measurement.

    Args:
        settings: constants of the run.
        path: (T, 3 + n), target (mm) and nearest reachable angles (rad) of each step.
        last_plan: (k, n + 3), as returned, or NaN for the tip where none was predicted.
        now: index of the step to command, from 1.
        steps: M, at most T - now, at least 1.
        commanded_rad: last command, within the limits, (n,).
        position_mm: the tip, (3,).
        extra_rad: of the model's configuration, see ``Tracking``, (n,).
    """
    problem = tracking(settings, path, now, steps, commanded_rad, position_mm, extra_rad)
    guess = shift(last_plan, path, now, steps)
    if not math.isnan(last_plan[0, -1]):
        guess -= correction(problem, position_mm - last_plan[0, -3:])
    guess = sqp.feasible(settings.bounds, commanded_rad, guess)
    solution = sqp.solve(problem, settings.bounds, guess, 1)
    return _result(settings.bounds, path, now, solution, problem)


def resume(
    settings: Settings,
    path: Array,
    now: int,
    steps: int,
    commanded_rad: Array,
    position_mm: Array,
    extra_rad: Array,
    unfinished: StepResult,
) -> StepResult:
    """Go on from a plan with the status NEEDS_QP."""
    problem = tracking(settings, path, now, steps, commanded_rad, position_mm, extra_rad)
    _, iteration, plan = unfinished
    solution = sqp.solve(problem, settings.bounds, plan[:, :-3].copy(), iteration)
    return _result(settings.bounds, path, now, solution, problem)


def tracking(
    settings: Settings,
    path: Array,
    now: int,
    steps: int,
    commanded_rad: Array,
    position_mm: Array,
    extra_rad: Array,
) -> Tracking:
    """Set up the problem of ``plan_step``."""
    offsets_mm = position_mm - path[now : now + steps, :3]
    path_rad = path[now - 1 : now + steps, 3:] - extra_rad
    free_rad = free_moves_rad(settings.constants.weights, path_rad, commanded_rad)
    return Tracking(settings.constants, commanded_rad, offsets_mm, free_rad, extra_rad)


def shift(last_plan: Array, path: Array, now: int, steps: int) -> Array:
    """The last plan without its first step, extended along the reachable path, (M, n)."""
    kept = min(len(last_plan) - 1, steps)
    guess = path[now : now + steps, 3:].copy()
    guess[kept:] += last_plan[kept, :-3] - path[now + kept - 1, 3:]
    guess[:kept] = last_plan[1 : 1 + kept, :-3]
    return guess


def correction(problem: Tracking, error_mm: Array) -> Array:
    """Angles, (n,), that the guess is off by, given the error of the tip against the last plan.

    A single damped least-squares step through J for the whole plan saves about a third of the
    iterations.
    """
    weights, chain = problem.constants.weights, problem.constants.chain
    start = (problem.start_rad + problem.extra_rad).reshape(1, len(problem.start_rad))
    jet = jets(chain, products(start, chain.bending))
    jacobian = products(chain.bending, jet[0, 1 : chain.bending.shape[1] + 1])
    gram = products(jacobian, jacobian.T)
    damping = weights.effort / weights.position
    damping = max(damping, _LEAST_DAMPING * squared(jacobian))
    for motor in range(len(gram)):
        gram[motor, motor] += damping
    is_definite, angles = solved(gram, products(jacobian, error_mm.reshape(3, 1)))
    return angles.ravel() if is_definite else np.zeros(len(gram))


def _result(
    bounds: Bounds, path: Array, now: int, solution: Solution, problem: Tracking
) -> StepResult:
    rollout = solution.rollout
    plan = np.empty((len(rollout.angles), rollout.angles.shape[1] + 3))
    # DAQP satisfies its bounds only to 1e-6 rad.
    plan[:, :-3] = sqp.feasible(bounds, problem.start_rad, rollout.angles)
    plan[:, -3:] = path[now : now + len(plan), :3] + rollout.errors_mm
    return solution.status, solution.iterations, plan


class Planner:
    """Plans the steps of a path, plain or compiled as ``solver`` of the description says.

    Raises:
        ConfigError: the solver needs an extra that is not installed.
    """

    def __init__(self, settings: Settings, solver: str) -> None:
        self._settings = settings
        self._plan_step: Callable[..., StepResult] = plan_step
        if solver == "compiled":
            import_optional("numba", "fast", "control.solver = compiled")
            from ccr_host.control.mpc.compiled import compiled_plan_step  # noqa: PLC0415 - optional

            self._plan_step = compiled_plan_step(settings)

    def begin(self, path: Array) -> None:
        """Begin a path (T, 3 + n), see ``plan_step``."""
        self._path = path

    def interrupt(self, q_rad: Array) -> None:
        """Discard the plan, as ``q_rad`` (n,) was commanded instead."""
        self._last_plan = np.concatenate([q_rad, np.full(3, math.nan)])[None, :]

    def plan(
        self, now: int, steps: int, commanded_rad: Array, position_mm: Array, extra_rad: Array
    ) -> StepResult:
        """Make a ``plan_step`` from the last plan."""
        settings, path = self._settings, self._path
        situation = now, steps, commanded_rad, position_mm, extra_rad
        result = self._plan_step(settings, path, self._last_plan, *situation)
        if result[0] == sqp.NEEDS_QP:
            result = resume(settings, path, *situation, result)
        self._last_plan = result[2]
        return result
