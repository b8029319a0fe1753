"""``plan``, compiled to machine code."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import ModuleType
from typing import Protocol, cast

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ccr_host.control import jit
from ccr_host.control.mpc import plan, problem, qp, sqp, two_motors
from ccr_host.control.mpc.plan import Code, Settings, StepResult
from ccr_host.control.mpc.problem import Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.control.mpc.two_motors import Geometry
from ccr_host.robot import arc

FloatArray = NDArray[np.float64]

SOURCES: tuple[ModuleType, ...] = (arc, two_motors, problem, qp, sqp, plan)
_plan_step: Callable[..., StepResult] = plan.plan_step
_resume: Callable[..., StepResult] = plan.resume

for _function in jit.functions_of(*SOURCES):
    if _function is not qp.minimise:
        jit.callable_when_compiled(_function)


# Plain Python passes the whole QP to DAQP.
overload(qp.minimise, jit_options={"error_model": "numpy"}, strict=False)(
    lambda *_: qp.minimise_without_bounds
)


class _Entry(Protocol):
    """A compiled function."""

    def __call__(self, *arguments: object) -> StepResult: ...

    def disable_compile(self) -> None: ...


def compiled_code(settings: Settings) -> Code:
    """Compiled or loaded by first calls; it then rejects arguments of other types."""
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
    """The functions that Python calls. Arguments are few and flat, as each costs time in numba."""
    fingerprint = jit.fingerprint(*SOURCES, jit)

    def plan_step_compiled(packed: FloatArray, *arguments: object) -> StepResult:
        _ = fingerprint
        return _plan_step(_unpacked(packed), *arguments)

    def resume_compiled(packed: FloatArray, *arguments: object) -> StepResult:
        _ = fingerprint
        return _resume(_unpacked(packed), *arguments)

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
