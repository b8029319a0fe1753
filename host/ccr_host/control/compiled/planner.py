"""The compiled planner behind the interface of ``control.planner``."""

from __future__ import annotations

import hashlib
import inspect
import math
from functools import lru_cache
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from ccr_host.control import nlp as plain_nlp
from ccr_host.control import sqp as plain_sqp
from ccr_host.control.compiled import box_qp, jit, model, nlp, sqp, step, warm_start
from ccr_host.control.compiled.model import Geometry
from ccr_host.control.compiled.step import PlanStep, Settings, make_plan_step
from ccr_host.control.planner import Plan
from ccr_host.control.sqp import Bounds, SolverError
from ccr_host.description.schema import Description
from ccr_host.robot import arc, kinematics
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference

FloatArray = NDArray[np.float64]

_SOURCES: tuple[ModuleType, ...] = (
    *(arc, kinematics, plain_nlp, plain_sqp),
    *(box_qp, jit, model, nlp, sqp, step, warm_start),
)
_FAILURES = {
    sqp.COST_NOT_FINITE: "the cost is not finite",
    sqp.NOT_CONVEX: "the Hessian is not positive definite",
    sqp.QP_FAILED: "the QP has no finite solution",
}


class CompiledPlanner:
    """The iterations of ``SqpPlanner`` in machine code.

    Building one compiles, or loads what was compiled before; planning never does.
    """

    def __init__(self, description: Description, model: ConstantCurvature, bounds: Bounds) -> None:
        control = description.control
        settings = Settings(
            Geometry.of(model),
            sqp.Bounds(*bounds.lower_rad, *bounds.upper_rad, bounds.step_rad),
            control.position_weight,
            control.effort_weight,
        )
        self._settings = settings.packed()
        self._limits = bounds
        self._live_steps = control.horizon - 1
        self._plan_step = _ready_plan_step(self._settings)
        self._path = np.empty((0, 5))
        self._last_plan = np.empty((0, 5))

    def begin(self, reference: Reference) -> FloatArray:
        limits = self._limits
        reachable_rad = np.clip(reference.q_rad, limits.lower_rad, limits.upper_rad)
        self._path = np.hstack([reference.target_mm, reachable_rad])
        first_rad: FloatArray = reachable_rad[0].copy()
        self.interrupt(first_rad)
        return first_rad

    def plan(self, now: int, commanded_rad: tuple[float, float], position_mm: FloatArray) -> Plan:
        steps = min(self._live_steps, len(self._path) - now)
        x, y, z = position_mm.tolist()
        status, iterations, plan = self._plan_step(
            self._settings, self._path, self._last_plan, now, steps, commanded_rad, (x, y, z)
        )
        if status in _FAILURES:
            raise SolverError(_FAILURES[status])
        self._last_plan = plan
        return Plan(plan[:, :2], plan[:, 2:], iterations, status == sqp.CONVERGED)

    def interrupt(self, q_rad: FloatArray) -> None:
        self._last_plan = np.full((1, 5), math.nan)
        self._last_plan[0, :2] = q_rad


@lru_cache(maxsize=1)
def _plan_step() -> PlanStep:
    digest = hashlib.sha256("".join(map(inspect.getsource, _SOURCES)).encode()).digest()
    return make_plan_step(int.from_bytes(digest[:7], "big"))


def _ready_plan_step(settings: FloatArray) -> PlanStep:
    """Compiled or loaded by a first call; from then on it refuses arguments of other types."""
    plan_step = _plan_step()
    nowhere = np.zeros((2, 5))
    plan_step(settings, nowhere, nowhere, 1, 1, (0.0, 0.0), (0.0, 0.0, 0.0))
    plan_step.disable_compile()
    return plan_step
