"""The uncertain parameters of any robot on tendons, for the static model of `chain_statics`.

The camera is believed to stand as registered, or aligned if it was not, as other controllers take
it. A turn of it can be told from the tendons' places and the weight to half a degree only, which
would be a millimetre at the tip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.parameter_space import ParameterSpace, Prior, Roles
from ccr_host.description.schema import Description
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.rest_model import Markers, RestModel
from ccr_host.robot.tendon_rest import TendonRobot

FloatArray = NDArray[np.float64]

_BOUND = 5.0
"""Prior deviations within which every parameter stays."""
_DEVIATIONS = {"slack": 1.0, "log_compliance": 1.0, "sag": 0.05}
"""Those of a robot that was not identified: a millimetre of slack, threads as well as ropes, and
the sag of five disks a segment."""
_DRIFTING = ("log_compliance", "slack", "weight")
"""Threads creep and tools change, while the geometry stays constant."""
_LOADS = ("weight", "tip_share")
_NOT_NEGATIVE = ("dead_travel", "tip_share")


@dataclass(frozen=True, eq=False)
class ChainParameters:
    """One robot, and others close to it."""

    score: FloatArray
    """(COUNT,)."""
    rest: TendonRobot
    half_dead_mm: FloatArray
    """Half the travel that each tendon loses after a reversal, (T,)."""
    near: tuple[ChainParameters, ...] = ()
    """Robots whose parameters are slightly different, see ``ChainSpace.perturbed``."""


class ChainSpace(ParameterSpace[ChainParameters]):
    """The parameters of any robot as scores.

    Args:
        description: of the robot.
    """

    def __init__(self, description: Description) -> None:
        robot = description.robot
        last = len(robot.chain) - 1
        offset_mm = np.array([0.0, robot.marker_offset_mm, 0.0])
        up = -np.array(robot.gravity_direction) @ PAPER_FRAME
        markers = Markers((0, last), offset_mm, are_from_base=True)
        self.model = RestModel(robot.chain, markers, up)
        """Robots by their scores; markers are the end of the first segment and the tip."""
        self.model.frame = PAPER_FRAME, np.zeros(3)
        self.winding_mm: FloatArray = robot.pulley_radius_mm * self.model.winding
        """Pull of each tendon over the motor angles, mm/rad, (T, n)."""
        kinds = [unknown.kind for unknown in self.model.unknowns]
        self._slack = [number for number, kind in enumerate(kinds) if kind == "slack"]
        mean = np.array([unknown.mean for unknown in self.model.unknowns])
        deviation = self.model.deviation
        for number, kind in enumerate(kinds):
            deviation[number] = _DEVIATIONS.get(kind, deviation[number])
        lower, upper = mean - _BOUND * deviation, mean + _BOUND * deviation
        lower[[kind in _NOT_NEGATIVE for kind in kinds]] = 0.0
        roles = Roles(
            drifting=[number for number, kind in enumerate(kinds) if kind in _DRIFTING],
            hindrances=[],
            loads=[number for number, kind in enumerate(kinds) if kind in _LOADS],
            pushes=[],
        )
        # Slack and stretch take a robot far from the prior.
        self.believable_mm = self.model.length_mm
        self.of_tendons = [n for n in roles.drifting if n not in roles.loads]
        """Numbers of those learnt along a path that change tendons alone; ``roles.loads`` are the
        others that are learnt."""
        super().__init__(Prior(mean, deviation, lower, upper), roles, description.tracker.noise_mm)

    def parameters(self, score: FloatArray) -> ChainParameters:
        model = self.model
        return ChainParameters(score, model.robot(score), model.half_dead_mm(score))

    def perturbed(self, score: FloatArray, probe: float) -> ChainParameters:
        near = tuple(map(self.parameters, score + probe * np.eye(self.count)))
        return replace(self.parameters(score), near=near)

    def by_shaft(self, shaft_rad: float) -> FloatArray:
        """The angle of a shaft is as much slack of each tendon that it winds."""
        scores = np.zeros((self.count, self.winding_mm.shape[1]))
        deviation_mm = self.deviation[self._slack][:, None]
        scores[self._slack] = -shaft_rad * self.winding_mm / deviation_mm
        return scores
