"""The uncertain parameters of any robot on tendons, for the static model of `chain_statics`.

The camera is believed to stand as registered, or aligned if it was not, as other controllers take
it. A turn of it can be told from the tendons' places and the weight to half a degree only, which
would be a millimetre at the tip.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.parameter_space import (
    BEFORE_SETUP_TURN_RAD,
    BEFORE_SETUP_ZERO_RAD,
    Mounting,
    ParameterSpace,
    Prior,
    Roles,
)
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.rest_model import MarkedRobot, Markers, RestModel

_BOUND = 5.0
"""Prior deviations within which every parameter stays."""
_DEVIATIONS = {"slack": 1.0, "log_compliance": 1.0, "sag": 0.05}
"""Those of a robot that was not identified: a millimetre of slack, threads as well as ropes, and
the sag of five disks a segment."""
_DRIFTING = ("log_compliance", "slack", "weight")
"""Threads creep and tools change, while the geometry stays constant."""
_LOADS = ("weight", "tip_share")
_MOST_OF_FEW, _SURPRISE_OF_FEW = 3.5, 1.6
"""Limits of a fit to few rests. Before uneven bending was in the model, parameters of 34 random
robots that match were up to 3.4 deviations off and the surprise up to 1.0, as there are more
unknowns than rests; a robot with wrong lengths or scales exceeds one of both."""
_VARYING_BY_IN_FEW = 2.0
"""Tendons that were strung alike have slack alike: 2 mm in all are as likely as in one. By the
prior each varies by 1 mm alone, and fits to few rests of such robots, which tell a fortieth of a
radius, put it up to 3.6 deviations off; with this 1.8 (11 robots of one and two segments)."""
_SLACK_START = 1.5
"""Slack, in deviations, from which few rests are fitted, too: the tendons that are let out then do
not pull against those that are wound. From taut tendons alone, 58 of 92 fits to robots with 0 to
2.5 mm of slack end within a cost of 3 of the best one known, from both starts 85."""
_HELD = ("friction", "marker", "glue", "weight"), 0.1
"""What looks like zeros in few rests, and the factor of its deviations for them."""
_NOT_NEGATIVE = ("dead_travel", "friction", "tip_share")
_SURE = ("length", "tendon_radius", "angle")
"""What does not vary beyond its prior from robot to robot."""


class Near(NamedTuple):
    """How some robots differ from one, K of them."""

    steps: Array
    """Differences of their scores, (K, P)."""
    turns: Array
    """``turn`` of each, (K, 3, 3)."""


@dataclass(frozen=True, eq=False)
class ChainParameters:
    """One robot, and others close to it."""

    score: Array
    """Scores of ``RestModel``, with zeros counted as slack, (P,)."""
    rest: MarkedRobot
    half_dead_mm: Array
    """Half the travel that each tendon loses after a reversal, (T,)."""
    turn: Array = field(default_factory=partial(np.eye, 3))
    """Rotation from the robot's frame to that of the camera, (3, 3)."""
    near: Near | None = None
    """Robots whose parameters are slightly different, see ``ChainSpace.perturbed``."""


class ChainSpace(ParameterSpace[ChainParameters]):
    """The parameters of any robot as scores.

    Of a new robot (``is_new``) the camera's turn and the servos' zeros are not known, and two
    parameters more each.
    """

    has_modes = True

    def __init__(self, description: Description, *, is_new: bool = False) -> None:
        robot = description.robot
        offset_mm = np.array([0.0, robot.marker_offset_mm, 0.0])
        up = -np.array(robot.gravity_direction) @ PAPER_FRAME
        markers = Markers(tuple(range(len(robot.chain))), offset_mm, are_from_base=True)
        self.model = RestModel(robot.chain, markers, up)
        """Robots by their scores; markers are the ends of the segments."""
        self.model.frame = PAPER_FRAME, np.zeros(3)
        self.winding_mm: Array = robot.pulley_radius_mm * self.model.winding
        """Pull of each tendon over the motor angles, mm/rad, (T, n)."""
        kinds = [unknown.kind for unknown in self.model.unknowns]
        self._own = len(kinds)
        """Number of those of the robot itself; turn and zeros come after them."""
        self._held = np.ones(self._own)
        """Factor by which deviations are smaller than those of the model."""
        self._slack = [number for number, kind in enumerate(kinds) if kind == "slack"]
        mean = np.array([unknown.mean for unknown in self.model.unknowns])
        deviation = self.model.deviation
        for number, kind in enumerate(kinds):
            deviation[number] = _DEVIATIONS.get(kind, deviation[number])
        lower, upper = mean - _BOUND * deviation, mean + _BOUND * deviation
        lower[[kind in _NOT_NEGATIVE for kind in kinds]] = 0.0
        roles = Roles(
            drifting=[number for number, kind in enumerate(kinds) if kind in _DRIFTING],
            hindrances=[kinds.index("friction")],
            warming=[],
            loads=[number for number, kind in enumerate(kinds) if kind in _LOADS],
            pushes=[],
            varying=[number for number, kind in enumerate(kinds) if kind not in _SURE],
            turns=[],
        )
        self._has_zero = np.ones((self.winding_mm.shape[1], 1))
        """Whether a motor's zero counts; that of a single tendon is its slack as well, (n, 1)."""
        # Slack and stretch take a robot far from the prior.
        self.believable_mm = self.model.length_mm
        if is_new:
            motors = self.winding_mm.shape[1]
            open_rad = np.repeat((BEFORE_SETUP_TURN_RAD, BEFORE_SETUP_ZERO_RAD), (3, motors))
            roles = roles._replace(turns=[self._own + axis for axis in range(3)])
            mean, deviation = np.append(mean, 0.0 * open_rad), np.append(deviation, open_rad)
            lower, upper = np.append(lower, -_BOUND * open_rad), np.append(upper, _BOUND * open_rad)
        super().__init__(Prior(mean, deviation, lower, upper), roles, description.tracker.noise_mm)

    @property
    def names(self) -> Sequence[str]:
        own = [unknown.name for unknown in self.model.unknowns]
        more = [f"turn_{axis}_rad" for axis in "xyz"]
        more += [f"zero_{motor}_rad" for motor in range(1, self.winding_mm.shape[1] + 1)]
        return (own + more)[: self.count]

    @property
    def zero_rad(self) -> Array:
        """Zeros follow from the slack of the tendons, as far as those of a segment differ in it.

        Zeros by which all motors of a segment only tighten its tendons cannot be told from slack.
        """
        zeros = slice(self._own + 3, None)
        by_value = np.zeros((self.winding_mm.shape[1], self.count))
        by_value[:, self._slack] = self._zero_by_slack
        by_value[:, zeros] = (self._zero_by_slack @ self.winding_mm)[:, : self.count - self._own]
        return by_value * self.deviation * self._has_zero

    @cached_property
    def _zero_by_slack(self) -> Array:
        """Zeros that explain most of the different slack of each segment's tendons, (n, T)."""
        own = np.equal.outer(self.model.segment_of, self.model.segment_of)
        from_mean = np.eye(len(own)) - own / own.sum(axis=1)
        return np.asarray(np.linalg.pinv(from_mean @ self.winding_mm) @ from_mean)

    def of_few_rests(self) -> ChainSpace:
        other = copy.copy(self)
        other.most_deviations = _MOST_OF_FEW
        other.most_surprise = _SURPRISE_OF_FEW
        other.varying_by = _VARYING_BY_IN_FEW
        pulled, let_out = self.winding_mm > 0.0, self.winding_mm < 0.0
        kinds = [unknown.kind for unknown in self.model.unknowns]
        other._held = np.where(np.isin(kinds, _HELD[0]), _HELD[1], 1.0)
        other.deviation = self.deviation * other._held
        other._has_zero = np.logical_and(pulled.any(axis=0), let_out.any(axis=0))[:, None] * 1.0
        return other

    def few_starts(self) -> Array:
        """The prior, and tendons with slack."""
        starts = np.zeros((2, self.count))
        starts[1, self._slack] = _SLACK_START
        return starts

    def mounting(self, score: Array) -> Mounting:
        robot = self.parameters(score).rest
        slack_mm = robot.slack_mm - self.winding_mm @ self.zero_rad @ score
        wound_mm = np.abs(self.winding_mm)
        share = wound_mm / (wound_mm**2).sum(axis=0)
        radius_mm = np.linalg.norm(robot.lever_mm, axis=2).max(axis=1)
        return Mounting(robot.lengths_mm, slack_mm @ share, 1.0 / (radius_mm @ share))

    def each(self, scores: Array) -> ChainParameters:
        """The parameters of the single set of scores to which ``starts`` is limited."""
        (score,) = scores
        return self.parameters(score)

    def starts(self) -> Array:
        """The prior alone."""
        return np.zeros((1, 1, self.count))

    def parameters(self, score: Array) -> ChainParameters:
        own, turn = self._own_of(score)
        return ChainParameters(own, self.model.robot(own), self.model.half_dead_mm(own), turn)

    def perturbed(self, score: Array, probe: float) -> ChainParameters:
        here = self.parameters(score)
        steps = probe * np.eye(self.count + 1, self.count)
        near = zip(*(self._own_of(score + step) for step in steps), strict=True)
        scores, turns = (np.array(column) for column in near)
        return replace(here, near=Near(scores - here.score, turns))

    def _own_of(self, score: Array) -> tuple[Array, Array]:
        """Scores of the robot itself, to whose slack zeros add, and the camera's turn, (3, 3)."""
        own, more_rad = self._held * score[: self._own], (self.deviation * score)[self._own :]
        if not len(more_rad):
            return own, np.eye(3)
        own[self._slack] += self.winding_mm @ more_rad[3:] / self.deviation[self._slack]
        return own, Rotation.from_rotvec(more_rad[:3]).as_matrix()

    def by_shaft(self, shaft_rad: float) -> Array:
        """The angle of a shaft is as much slack of each tendon that it winds."""
        scores = np.zeros((self.count, self.winding_mm.shape[1]))
        deviation_mm = self.deviation[self._slack][:, None]
        scores[self._slack] = -shaft_rad * self.winding_mm / deviation_mm
        return scores
