"""The computations at every measurement, plain or compiled as ``control.solver`` says."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from ccr_host.control.adaptive import motion, path_plan
from ccr_host.control.adaptive.arithmetic import FloatArray
from ccr_host.control.adaptive.identification import predicted_mm
from ccr_host.control.adaptive.motion import Pose, first_pose, turned
from ccr_host.control.adaptive.parameters import COUNT, Parameters, Scaling
from ccr_host.core.plugins import import_optional
from ccr_host.description.schema import Control
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory

PROBE = 1e-5
"""Perturbation of scores and setpoints, for derivatives."""


class Sensitivity(NamedTuple):
    """``tip`` (3, COUNT + 1), ``theta_rad`` (2, COUNT + 1): a column for each score, then time."""

    tip: FloatArray
    theta_rad: FloatArray


class StaticModel(Protocol):
    """The interface of the computations; both implementations share the formulas."""

    def moved(self, p: Parameters, pose: Pose, setpoint_rad: FloatArray) -> Pose:
        """``motion.moved`` to setpoints, (2,)."""
        ...

    def sensitivity(
        self, scaling: Scaling, score: FloatArray, pose: Pose, rate_rad_s: FloatArray
    ) -> Sensitivity:
        """Derivatives of the tip at rest in parameters and setpoints, see ``motion.change_of``.

        Args:
            scaling: scaling of the scores.
            score: scores of the parameters, (COUNT,).
            pose: pose at rest.
            rate_rad_s: rate of the setpoints, (2,), for the last column, a speed.
        """
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
    """The computations in plain Python; several parameter sets at once are arrays."""

    predicted_mm = staticmethod(predicted_mm)
    polished = staticmethod(path_plan.polished)

    def moved(self, p: Parameters, pose: Pose, setpoint_rad: FloatArray) -> Pose:
        return motion.moved(p, pose, *setpoint_rad.tolist())

    def sensitivity(
        self, scaling: Scaling, score: FloatArray, pose: Pose, rate_rad_s: FloatArray
    ) -> Sensitivity:
        here = motion.slopes_of(scaling.parameters(score), pose)
        travel_1, travel_2 = np.zeros((2, COUNT + 1))
        travel_1[-1], travel_2[-1] = PROBE * rate_rad_s
        near = scaling.perturbed(score, PROBE)
        columns = np.array(motion.change_of(here, near, pose, travel_1, travel_2)) / PROBE
        return Sensitivity(columns[:3], columns[3:])


PLAIN = PlainModel()


def make_model(control: Control) -> StaticModel:
    """Make the model that ``control.solver`` names.

    Raises:
        ConfigError: it needs an extra that is not installed.
    """
    if control.solver == "compiled":
        import_optional("numba", "fast", "control.solver = compiled")
        from ccr_host.control.adaptive.compiled import CompiledModel  # noqa: PLC0415 - optional

        return CompiledModel()
    return PLAIN


class PoseFollower:
    """Follows a history of setpoints completely, as backlash and friction depend on every turn.

    Args:
        p: parameters, floats.
        history: history of the setpoints.
        time_s: time from which to follow it.
        model: computes the poses.
    """

    def __init__(
        self,
        p: Parameters,
        history: SetpointHistory,
        time_s: float,
        model: StaticModel = PLAIN,
    ) -> None:
        self._model = model
        self._history = history
        self._time_s = time_s
        self.pose = first_pose(p, *history.at(time_s).tolist())

    def advance_to(self, p: Parameters, time_s: float) -> Pose:
        """The pose at a time, or the present one if that is later."""
        if time_s > self._time_s:
            for setpoint_rad in self._history.corners(self._time_s, time_s):
                self.pose = self._model.moved(p, self.pose, setpoint_rad)
            self._time_s = time_s
        return self.pose

    def ahead(self, p: Parameters) -> Pose:
        """Backlash and friction after all commands; the bending angles are not updated."""
        pose = self.pose
        for setpoint_rad in self._history.corners(self._time_s, math.inf):
            if p.friction_1 > 0.0:
                pose = self._model.moved(p, pose, setpoint_rad)
            else:
                pose = turned(p, pose, *setpoint_rad.tolist())
        return pose
