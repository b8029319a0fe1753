"""``plan`` as machine code."""

from __future__ import annotations

from functools import lru_cache
from types import ModuleType
from typing import Any, Protocol, cast

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ccr_host.control import jit
from ccr_host.control.mpc import plan, problem, qp, sqp
from ccr_host.control.mpc.plan import Code, Settings, StepResult, Triple, plan_step, resume
from ccr_host.control.mpc.problem import Pair, Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.robot import arc, kinematics
from ccr_host.robot.kinematics import Geometry

FloatArray = NDArray[np.float64]

SOURCES: tuple[ModuleType, ...] = (arc, kinematics, problem, qp, sqp, plan)

for _function in jit.functions_of(*SOURCES):
    if _function is not qp.minimise:
        jit.callable_when_compiled(_function)


@overload(qp.minimise, jit_options={"error_model": "numpy"}, strict=False)
def _minimise(*_: object) -> Any:  # noqa: ANN401 - a function, as numba takes it
    return qp.minimise_without_bounds


class _Entry(Protocol):
    """A compiled function."""

    def __call__(self, *arguments: object) -> StepResult: ...

    def disable_compile(self) -> None: ...


def compiled_code(settings: Settings) -> Code:
    """Compiled or loaded by first calls; from then on it refuses arguments of other types."""
    packed = np.array(
        [
            *settings.geometry.lengths_mm,
            *settings.geometry[1:],
            *settings.bounds.lower_rad,
            *settings.bounds.upper_rad,
            settings.bounds.step_rad,
            *settings.weights,
        ]
    )
    first, again = _entries()
    nowhere, pair, triple = np.zeros((2, 5)), (0.0, 0.0), (0.0, 0.0, 0.0)
    program = np.empty((3, 2))
    first(packed, nowhere, nowhere, 1, 1, pair, triple, program)
    again(packed, nowhere[1:], nowhere[1:], pair, triple, program, (np.zeros(2), 0.0, 1.0), 1)
    for entry in (first, again):
        entry.disable_compile()
    return Code(packed, first, again, lambda array: array)


@lru_cache(maxsize=1)
def _entries() -> tuple[_Entry, _Entry]:
    """What Python calls. Arguments are few and flat since numba takes time to pass each."""
    fingerprint = jit.fingerprint(*SOURCES)

    def plan_step_compiled(
        packed: FloatArray,
        path: FloatArray,
        last_plan: FloatArray,
        now: int,
        steps: int,
        commanded_rad: Pair,
        position_mm: Triple,
        program: FloatArray,
    ) -> StepResult:
        _ = fingerprint
        settings = _unpacked(packed)
        return plan_step(settings, path, last_plan, now, steps, commanded_rad, position_mm, program)

    def resume_compiled(
        packed: FloatArray,
        targets_mm: FloatArray,
        plan_so_far: FloatArray,
        commanded_rad: Pair,
        position_mm: Triple,
        program: FloatArray,
        newton: tuple[FloatArray, float, float],
        iteration: int,
    ) -> StepResult:
        _ = fingerprint
        settings = _unpacked(packed)
        return resume(
            settings,
            targets_mm,
            plan_so_far,
            commanded_rad,
            position_mm,
            program,
            newton,
            iteration,
        )

    entries = plan_step_compiled, resume_compiled
    first, again = (cast(_Entry, jit.compiled_on_disk(entry)) for entry in entries)
    return first, again


@jit.callable_when_compiled
def _unpacked(packed: FloatArray) -> Settings:
    return Settings(
        Geometry((packed[0], packed[1]), packed[2], packed[3]),
        Bounds((packed[4], packed[5]), (packed[6], packed[7]), packed[8]),
        Weights(packed[9], packed[10]),
    )
