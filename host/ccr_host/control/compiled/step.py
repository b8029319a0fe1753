"""A whole step of the planner: measurement in, plan out."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.compiled.jit import compiled, compiled_on_disk
from ccr_host.control.compiled.model import Geometry, jet_at
from ccr_host.control.compiled.nlp import Rollout, Tracking
from ccr_host.control.compiled.sqp import Bounds, solve
from ccr_host.control.compiled.warm_start import Triple, clip, correct, make_feasible, shift

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]


class Settings(NamedTuple):
    """What stays the same over a run."""

    geometry: Geometry
    bounds: Bounds
    position_weight: float
    effort_weight: float

    def packed(self) -> FloatArray:
        """As ``plan_step`` takes them."""
        weights = self.position_weight, self.effort_weight
        return np.array([*self.geometry, *self.bounds, *weights])


class PlanStep(Protocol):
    """What ``make_plan_step`` makes."""

    def __call__(
        self,
        packed_settings: FloatArray,
        path: FloatArray,
        last_plan: FloatArray,
        now: int,
        live_steps: int,
        commanded_rad: Pair,
        position_mm: Triple,
    ) -> tuple[int, int, FloatArray]:
        """Plan ahead from one measurement.

        Args:
            packed_settings: of ``Settings``.
            path: (T, 5), target (mm) and nearest reachable angles (rad) of each step.
            last_plan: (k, 5), as returned, or NaN for the tip where none was predicted.
            now: index of the step to command.
            live_steps: M, at most T - now, at least 1.
            commanded_rad: within the limits.
            position_mm: the tip.

        Returns:
            Outcome as ``sqp.solve``, iterations, and the plan (M, 5): angles (rad) and predicted
            tip (mm) of each step.
        """
        ...

    def disable_compile(self) -> None:
        """Refuse arguments of types that it was not compiled for."""
        ...


def make_plan_step(fingerprint: int) -> PlanStep:
    """The compiled step. Its arguments are few and flat since numba takes time to pass each.

    Args:
        fingerprint: of all code that the step is made of. Numba's cache on disk watches this file
            alone, but it tells apart functions that enclose different values.
    """

    def plan_step(
        packed_settings: FloatArray,
        path: FloatArray,
        last_plan: FloatArray,
        now: int,
        live_steps: int,
        commanded_rad: Pair,
        position_mm: Triple,
    ) -> tuple[int, int, FloatArray]:
        _ = fingerprint
        settings = _unpack(packed_settings)
        targets_mm = path[now : now + live_steps, :3]
        problem = _tracking(settings, commanded_rad, position_mm, targets_mm)
        guess = shift(last_plan[:, :2], path[:, 3:], now, live_steps)
        if not math.isnan(last_plan[0, 2]):
            correct(guess, problem, position_mm, last_plan[0, 2:])
        make_feasible(guess, commanded_rad, settings.bounds)
        status, iterations, rollout = solve(problem, settings.bounds, guess)
        return status, iterations, _plan(settings.bounds, targets_mm, rollout)

    return cast(PlanStep, compiled_on_disk(plan_step))


@compiled
def _unpack(packed: FloatArray) -> Settings:
    return Settings(
        Geometry(packed[0], packed[1], packed[2], packed[3]),
        Bounds(packed[4], packed[5], packed[6], packed[7], packed[8]),
        packed[9],
        packed[10],
    )


@compiled
def _tracking(
    settings: Settings, start_rad: Pair, position_mm: Triple, targets_mm: FloatArray
) -> Tracking:
    steps = len(targets_mm)
    across, sagittal = np.empty(steps), np.empty(steps, np.complex128)
    for j in range(steps):
        across[j] = position_mm[0] - targets_mm[j, 0]
        sagittal[j] = complex(targets_mm[j, 1] - position_mm[1], position_mm[2] - targets_mm[j, 2])
    return Tracking(
        settings.geometry,
        settings.position_weight,
        settings.effort_weight,
        start_rad,
        jet_at(settings.geometry, start_rad[0], start_rad[1]),
        across,
        sagittal,
    )


@compiled
def _plan(bounds: Bounds, targets_mm: FloatArray, rollout: Rollout) -> FloatArray:
    plan = np.empty((len(targets_mm), 5))
    for j in range(len(plan)):
        angle_1, angle_2 = rollout.angles[j, 0], rollout.angles[j, 1]
        plan[j, 0], plan[j, 1] = clip(bounds, angle_1, angle_2)
        plan[j, 2] = targets_mm[j, 0] + rollout.error_across_mm[j]
        plan[j, 3] = targets_mm[j, 1] - rollout.error_sagittal_mm[j].real
        plan[j, 4] = targets_mm[j, 2] + rollout.error_sagittal_mm[j].imag
    return plan
