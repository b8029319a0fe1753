"""What recurs with every measurement, in Python or compiled, as ``control.solver`` says."""

from __future__ import annotations

from typing import Protocol

from ccr_host.control.adaptive import identification, motion, path_plan, sensitivity
from ccr_host.control.adaptive.identification import Rests, Scaling
from ccr_host.control.adaptive.motion import Rest
from ccr_host.control.adaptive.parameters import FloatArray, Parameters
from ccr_host.control.adaptive.sensitivity import Sensitivity
from ccr_host.core.plugins import import_optional
from ccr_host.description.schema import Control


class StaticModel(Protocol):
    """The computations; the functions of the same names say what they do."""

    def moved(self, p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
        """``motion.moved``."""
        ...

    def held_after(self, p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
        """``motion.held_after``."""
        ...

    def sensitivity(
        self, scaling: Scaling, score: FloatArray, rest: Rest, rate_rad_s: FloatArray
    ) -> Sensitivity:
        """``sensitivity.sensitivity``."""
        ...

    def predicted_mm(self, p: Parameters, rests: Rests) -> FloatArray:
        """``identification.predicted_mm``."""
        ...

    def polished(
        self, p: Parameters, theta_rad: FloatArray, target_mm: FloatArray, iterations: int
    ) -> FloatArray:
        """``path_plan.polished``."""
        ...


class PlainModel:
    """In Python."""

    moved = staticmethod(motion.moved)
    held_after = staticmethod(motion.held_after)
    sensitivity = staticmethod(sensitivity.sensitivity)
    predicted_mm = staticmethod(identification.predicted_mm)
    polished = staticmethod(path_plan.polished)


PLAIN = PlainModel()


def make_model(control: Control) -> StaticModel:
    """The model that ``control.solver`` names.

    Raises:
        ConfigError: it needs an extra that is not installed.
    """
    if control.solver == "compiled":
        import_optional("numba", "fast", "control.solver = compiled")
        from ccr_host.control.adaptive.compiled import CompiledModel  # noqa: PLC0415 - optional

        return CompiledModel()
    return PLAIN
