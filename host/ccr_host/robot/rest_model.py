"""Rest poses of a described robot with uncertain parameters, each with its prior.

Unknown are lengths, radii, stiffness and compliance of the segments, sag, dead travel, slack and
place of every tendon, weight, places of the markers, and where the robot stands in the frame of the
measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Segment
from ccr_host.robot.arc import SHORTER_BY_SAG
from ccr_host.robot.chain import Weights
from ccr_host.robot.kinematics import freedom_of
from ccr_host.robot.tendon_rest import TendonRobot, pulled_mm

FloatArray = NDArray[np.float64]

_MARKERS_MM, _GLUE_MM, _PLACE_MM = 0.7, 0.5, 5.0
"""Deviation of all markers from their described place, of each from that of the tip, and of the
origin of other measurements."""
_PROBE_RAD, _PROBE = 1e-6, 1e-5
_PLACING, _PULLING = ("turn", "base", "glue"), ("dead_travel", "slack", "angle", "log_compliance")
"""What changes no moment, and what changes no place at the same bending, nor any weight."""
_WEIGHT = 0.4
"""Deviation of the weight times the robot's length, over the stiffness of segment 1."""


@dataclass(frozen=True)
class Unknown:
    """A parameter of the fit, and its prior."""

    kind: str
    of: str
    """Number of the segment or tendon, or axis."""
    unit: str
    mean: float
    deviation: float

    @property
    def name(self) -> str:
        """As in ``length_2_mm``."""
        return "_".join(filter(None, (self.kind, self.of, self.unit)))


class Markers(NamedTuple):
    """What is seen of a robot."""

    ends: tuple[int, ...]
    """Numbers, from 0, of the segments at whose ends there is a marker."""
    offset_mm: FloatArray
    """Marker seen from the backbone, in the frame of its disk, (3,)."""
    are_from_base: bool
    """Whether they are seen from another marker at the base, not from anywhere near it."""


def tip_alone(segments: int) -> Markers:
    """The end of the backbone, seen from anywhere near the base."""
    return Markers((segments - 1,), np.zeros(3), are_from_base=False)


class Slopes(NamedTuple):
    """Derivatives at N rests; P are the scores by which they are taken."""

    markers: FloatArray
    """By the scores, (N, ends, 3, P)."""
    yielding: FloatArray
    """Of the degrees of freedom by the scores, (N, D, P)."""
    by_freedom: FloatArray
    """Of the markers at bending, (N, ends, 3, D)."""
    compliance: FloatArray
    """Of the degrees of freedom by moments, (N, D, D)."""


class RestModel:
    """The robots that a description may mean, in the frame of their base until that is placed.

    Args:
        segments: as described.
        markers: what is measured; by default the tip.
        up: direction against gravity in the frame of the base, (3,), if the measurement is aligned
            with that frame; the tip may then have a weight beyond that of the segments.
    """

    def __init__(
        self,
        segments: tuple[Segment, ...],
        markers: Markers | None = None,
        up: FloatArray | None = None,
    ) -> None:
        self._segments = segments
        self._markers = markers or tip_alone(len(segments))
        tendons = [(j, tendon) for j, s in enumerate(segments) for tendon in s.tendons]
        self.segment_of = np.array([j for j, _ in tendons])
        """Number of each tendon's segment, from 0, (T,)."""
        self.winding = np.zeros((len(tendons), max(tendon.motor for _, tendon in tendons)))
        """Pull of each tendon over that of the motors, (T, n)."""
        for row, (_, tendon) in enumerate(tendons):
            self.winding[row, tendon.motor - 1] = tendon.winding
        self._passes = np.arange(len(segments)) <= self.segment_of[:, None]
        self._angle_rad = np.radians([tendon.angle_deg for _, tendon in tendons])
        self.freedom = freedom_of(segments)
        self.length_mm = sum(s.length_mm for s in segments)
        slack_mm = [tendon.slack_mm for _, tendon in tendons]
        place_mm = _GLUE_MM if self._markers.are_from_base else _PLACE_MM
        glued = [str(end + 1) for end in self._markers.ends[:-1]]
        self.unknowns = _unknowns(segments, slack_mm, place_mm, up, glued)
        self._mean = np.array([u.mean for u in self.unknowns])
        self.deviation = np.array([u.deviation for u in self.unknowns])
        self._groups = _groups(self.unknowns)
        self.frame = np.eye(3), np.zeros(3)
        """Rotation and place of the base in the frame of the measurement, before ``turn``."""

    def values(self, score: FloatArray) -> FloatArray:
        """Parameters of scores, (parameter - mean) / deviation of the prior, both (P,)."""
        values: FloatArray = self._mean + self.deviation * score
        dead = self._groups["dead_travel"]
        values[dead] = np.abs(values[dead])
        return values

    def group(self, score: FloatArray, name: str) -> FloatArray:
        """The parameters whose names begin with this one, in order."""
        values: FloatArray = self.values(score)[self._groups[name]]
        return values

    def robot(self, score: FloatArray) -> TendonRobot:
        """The robot that the parameters stand for."""
        radius_mm = self.group(score, "tendon_radius")
        angle_rad = self._angle_rad + self.group(score, "angle")
        towards = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
        at_mm = self._passes * radius_mm
        lengths_mm = self.group(score, "length")
        compliance = np.exp(self.group(score, "log_compliance"))[self.segment_of]
        own_mm = radius_mm[self.segment_of]
        sag = self.group(score, "sag")
        at_end = np.zeros(len(self._segments))
        at_end[-1] = self.group(score, "tip_share").sum()
        hung_mm = at_end[-1] * self._places_mm(score)[-1]
        return TendonRobot(
            lengths_mm=lengths_mm,
            freedom=self.freedom,
            stiffness=np.exp(np.append(0.0, self.group(score, "log_stiffness"))),
            lever_mm=at_mm[..., None] * towards[:, None],
            sag_mm=at_mm * sag,
            shorter_mm=SHORTER_BY_SAG * radius_mm * sag,
            softening=np.tril(2.0 * np.outer(1.0 / radius_mm, radius_mm * sag)),
            slack_mm=self.group(score, "slack"),
            tendon_stiffness_mm2=1.0 / (compliance * own_mm**2),
            load_mm=self.group(score, "weight"),
            weights=Weights(at_end, lengths_mm / lengths_mm.sum(), hung_mm),
        )

    def half_dead_mm(self, score: FloatArray) -> FloatArray:
        """Half the dead travel of each tendon, (T,)."""
        half: FloatArray = 0.5 * self.group(score, "dead_travel")[self.segment_of]
        return half

    def travel_mm(
        self, score: FloatArray, start_mm: FloatArray, wound_mm: FloatArray
    ) -> FloatArray:
        """Pull of each tendon behind its dead travel, (N, T): the play operator over all rows.

        Args:
            score: of the robot, (P,).
            start_mm: pull of each before the first row, (T,).
            wound_mm: what the motors have wound up at each row, (N, T).
        """
        half_mm, behind = self.half_dead_mm(score), start_mm
        rows: FloatArray = np.empty_like(wound_mm)
        for number, wound in enumerate(wound_mm):
            rows[number] = behind = pulled_mm(behind, wound, half_mm)
        return rows

    @property
    def nothing(self) -> FloatArray:
        """Scores of the description itself, (P,)."""
        return np.zeros(len(self.unknowns))

    def seen_mm(self, score: FloatArray, robot: TendonRobot, y: FloatArray) -> FloatArray:
        """Markers in the frame of the measurement at rest, (..., D) -> (..., ends, 3)."""
        moved_mm = self.frame[1] + self.group(score, "base")
        seen: FloatArray = self.ends_mm(score, robot, y) @ self.turn(score).T + moved_mm
        return seen

    def ends_mm(self, score: FloatArray, robot: TendonRobot, y: FloatArray) -> FloatArray:
        """Markers relative to that at the base, (..., D) -> (..., ends, 3)."""
        halves_rad, places_mm = robot.halves_rad(y), self._places_mm(score)
        ends = zip(self._markers.ends, places_mm, strict=True)
        return np.stack([robot.end_mm(halves_rad, *end) - places_mm[-1] for end in ends], axis=-2)

    def seen_by(
        self, score: FloatArray, robot: TendonRobot, y: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """``seen_mm`` and its derivatives, (N, ends, 3, D)."""
        steps = np.concatenate([np.zeros((1, y.shape[-1])), _PROBE_RAD * np.eye(y.shape[-1])])
        here_mm, *near_mm = np.moveaxis(self.seen_mm(score, robot, y[:, None] + steps), 1, 0)
        return here_mm, (np.stack(near_mm, axis=-1) - here_mm[..., None]) / _PROBE_RAD

    def slopes(
        self,
        score: FloatArray,
        y: FloatArray,
        travel_of: Callable[[FloatArray], FloatArray],
        numbers: Sequence[int] | None = None,
    ) -> Slopes:
        """Derivatives at rest by the implicit function theorem: g(y, p) = 0, dy = -g_y^-1 g_p dp.

        Args:
            score: of the robot.
            y: its degrees of freedom at rest, (N, D).
            travel_of: pull of each tendon there by the scores, (N, T).
            numbers: those of the scores by which derivatives are taken; by default all.
        """
        robot, travel_mm = self.robot(score), travel_of(score)
        here_mm, by_freedom = self.seen_by(score, robot, y)
        weightless = replace(robot, load_mm=np.zeros(3)).moments(y, travel_mm)
        moments = robot.moments(y, travel_mm)
        numbers = range(len(score)) if numbers is None else numbers
        more, moved = np.zeros((*y.shape, len(numbers))), np.zeros((*here_mm.shape, len(numbers)))
        for column, number in enumerate(numbers):
            kind = self.unknowns[number].kind
            near = score.copy()
            near[number] += _PROBE
            other = self.robot(near)
            if kind in _PULLING:
                led_mm = travel_of(near) if kind == "dead_travel" else travel_mm
                other = replace(other, load_mm=np.zeros(3))
                more[..., column] = other.moments(y, led_mm) - weightless
                continue
            if kind not in _PLACING:
                more[..., column] = other.moments(y, travel_mm) - moments
            moved[..., column] = self.seen_mm(near, other, y) - here_mm
        compliance = robot.compliance(y, travel_mm)
        yielding = -compliance @ more / _PROBE
        markers = moved / _PROBE + by_freedom @ yielding[:, None]
        return Slopes(markers, yielding, by_freedom, compliance)

    def _places_mm(self, score: FloatArray) -> FloatArray:
        """Each marker seen from the backbone, in the frame of its disk, (ends, 3)."""
        places_mm = np.tile(self._markers.offset_mm, (len(self._markers.ends), 1))
        places_mm += self.group(score, "marker")
        places_mm[:-1] += self.group(score, "glue").reshape(-1, 3)
        return places_mm

    def turn(self, score: FloatArray) -> FloatArray:
        """The turn from the robot's frame to that of the measurement, (3, 3)."""
        vector = self.group(score, "turn")
        if not len(vector):
            return self.frame[0]
        turn: FloatArray = Rotation.from_rotvec(vector).as_matrix() @ self.frame[0]
        return turn


def _unknowns(
    segments: tuple[Segment, ...],
    slack_mm: list[float],
    place_deviation_mm: float,
    up: FloatArray | None,
    glued: list[str],
) -> list[Unknown]:
    """All parameters with their prior; stiffness and compliance by their logarithms.

    Lengths are known to 5 %, radii to 7 %, tendons' places to 7 deg. The rest are assumptions about
    robots on tendons: a few per cent of a radian of stretch, a millimetre of slack, weight that
    bends by a tenth of a radian.
    """
    named = [(str(number), segment) for number, segment in enumerate(segments, 1)]
    weight = _WEIGHT / sum(s.length_mm for s in segments)
    weight_mean = np.zeros(3) if up is None else 0.5 * weight * up
    turn = [Unknown("turn", axis, "rad", 0.0, 0.1) for axis in "xyz"]
    tip = [Unknown("tip_share", "", "", 0.5, 0.5)]
    return [
        *(Unknown("length", n, "mm", s.length_mm, 0.05 * s.length_mm) for n, s in named),
        *(
            Unknown("tendon_radius", n, "mm", s.tendon_radius_mm, 0.07 * s.tendon_radius_mm)
            for n, s in named
        ),
        *(Unknown("log_stiffness", n, "", math.log(s.stiffness), 0.3) for n, s in named[1:]),
        *(Unknown("log_compliance", n, "", math.log(s.compliance), 0.7) for n, s in named),
        *(Unknown("sag", n, "", s.sag, 0.02) for n, s in named),
        *(Unknown("dead_travel", n, "mm", s.dead_travel_mm + 0.1, 0.2) for n, s in named),
        *(Unknown("slack", str(n), "mm", s, 0.6) for n, s in enumerate(slack_mm, 1)),
        *(Unknown("angle", str(n), "rad", 0.0, 0.12) for n in range(1, len(slack_mm) + 1)),
        *(
            Unknown("weight", axis, "per_mm", mean, weight)
            for axis, mean in zip("xyz", weight_mean.tolist(), strict=True)
        ),
        *(turn if up is None else tip),
        *(Unknown("marker", axis, "mm", 0.0, _MARKERS_MM) for axis in "xyz"),
        *(Unknown("glue", f"{n}_{axis}", "mm", 0.0, _GLUE_MM) for n in glued for axis in "xyz"),
        *(Unknown("base", axis, "mm", 0.0, place_deviation_mm) for axis in "xyz"),
    ]


def _groups(unknowns: list[Unknown]) -> dict[str, NDArray[np.intp]]:
    names = [unknown.kind for unknown in unknowns]
    return {
        name: np.array([i for i, own in enumerate(names) if own == name], dtype=np.intp)
        for name in {*names, "log_stiffness", "tip_share", "turn", "glue"}
    }
