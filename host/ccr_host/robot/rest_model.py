"""Rest poses of a described robot with uncertain parameters, each with its prior.

Unknown are lengths, radii, stiffness and compliance of the segments, sag, dead travel, slack and
place of every tendon, weight, places of the markers, and where the robot stands in the frame of the
measurement. Of a measurement in any frame, so is the clocking of the segments: how far the holes of
each, which all tendons pass there, are turned about the backbone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ccr_host.core.arrays import Array
from ccr_host.description.schema import Segment
from ccr_host.robot.arc import SHORTER_BY_SAG
from ccr_host.robot.chain import Weights
from ccr_host.robot.kinematics import freedom_of
from ccr_host.robot.tendon_rest import TendonRobot, pulled_mm, steps_from_here

_MARKERS_MM, _GLUE_MM, _PLACE_MM = 0.7, 0.5, 5.0
"""Deviation of all markers from their described place, of each from that of the tip, and of the
origin of other measurements."""
_PROBE_RAD, _PROBE = 1e-6, 1e-5
_HOLES_RAD = 0.12
"""Deviation of the place of a tendon's holes, and of those of a segment, about the backbone."""
_PULLING = ("dead_travel", "friction", "slack", "angle", "clocking", "log_compliance")
"""What changes no place at the same bending, nor any weight."""
_FRICTION_RAD = 0.1
"""Deviation of the bending of segment 1 that the dry friction of one of its tendons withstands."""
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
        """Its name in tables, such as ``length_2_mm``."""
        return "_".join(filter(None, (self.kind, self.of, self.unit)))


class Markers(NamedTuple):
    """What is seen of a robot."""

    ends: tuple[int, ...]
    """Numbers, from 0, of the segments at whose ends there is a marker."""
    offset_mm: Array
    """Marker seen from the backbone, in the frame of its disk, (3,)."""
    are_from_base: bool
    """Whether they are seen from another marker at the base, not from anywhere near it."""


class Slopes(NamedTuple):
    """Derivatives at N rests; P are the scores by which they are taken."""

    markers: Array
    """Derivatives of the markers by the scores, (N, ends, 3, P)."""
    yielding: Array
    """Derivatives of the degrees of freedom by the scores, (N, D, P)."""
    by_freedom: Array
    """Derivatives of the markers by the degrees of freedom, (N, ends, 3, D)."""
    compliance: Array
    """Derivatives of the degrees of freedom by moments, (N, D, D)."""


@dataclass(frozen=True, eq=False)
class MarkedRobot(TendonRobot):
    """A robot, or several, and where its markers are."""

    ends: tuple[int, ...]
    """Segments that end with a marker, see ``Markers``."""
    places_mm: Array
    """Each marker seen from the backbone, in the frame of its disk, (..., ends, 3)."""
    turn: Array
    """Rotation from the robot's frame to that of the measurement, (..., 3, 3)."""
    origin_mm: Array
    """Place of the base in the frame of the measurement, (..., 3)."""

    def seen_mm(self, y: Array) -> Array:
        """Markers relative to that at the base, (..., D) -> (..., ends, 3), at rest."""
        disks, seen = self.ends_mm(y), []
        for number, end in enumerate(self.ends):
            place, turn = disks[end]
            seen.append((place + turn @ self.places_mm[..., number, :, None])[..., 0])
        robot_mm = np.stack(seen, axis=-2) - self.places_mm[..., -1:, :]
        seen_mm: Array = robot_mm @ np.swapaxes(self.turn, -1, -2)
        return seen_mm + self.origin_mm[..., None, :]

    def seen_by(self, y: Array) -> tuple[Array, Array]:
        """``seen_mm`` of one robot and its derivatives, (..., ends, 3, D)."""
        near = self.seen_mm(y[..., None, :] + steps_from_here(y.shape[-1], _PROBE_RAD))
        here_mm = near[..., :1, :, :]
        by_y = np.moveaxis((near[..., 1:, :, :] - here_mm) / _PROBE_RAD, -3, -1)
        return here_mm[..., 0, :, :], by_y


class RestModel:
    """The robots that a description may mean, in the frame of their base until that is placed.

    Args:
        segments: as described.
        markers: what is measured; by default the end of the backbone.
        up: direction against gravity in the frame of the base, (3,), if the measurement is aligned
            with that frame; the tip may then have a weight beyond that of the segments.
    """

    def __init__(
        self,
        segments: tuple[Segment, ...],
        markers: Markers | None = None,
        up: Array | None = None,
    ) -> None:
        self._segments = segments
        self._markers = markers or Markers((len(segments) - 1,), np.zeros(3), are_from_base=False)
        tendons = [(j, tendon) for j, s in enumerate(segments) for tendon in s.tendons]
        self.segment_of = np.array([j for j, _ in tendons])
        """Number of each tendon's segment, from 0, (T,)."""
        self.winding = np.zeros((len(tendons), max(tendon.motor for _, tendon in tendons)))
        """Pull of each tendon over that of the motors, (T, n)."""
        for row, (_, tendon) in enumerate(tendons):
            self.winding[row, tendon.motor - 1] = tendon.winding
        self._passes = np.arange(len(segments)) <= self.segment_of[:, None]
        clocking_deg = np.array([s.clocking_deg for s in segments])
        angle_deg = np.array([[tendon.angle_deg] for _, tendon in tendons])
        self._angle_rad = np.radians(angle_deg + clocking_deg)
        self.freedom = freedom_of(segments)
        self.length_mm = sum(s.length_mm for s in segments)
        slack_mm = [tendon.slack_mm for _, tendon in tendons]
        place_mm = _GLUE_MM if self._markers.are_from_base else _PLACE_MM
        glued = [str(end + 1) for end in self._markers.ends[:-1]]
        self.unknowns = _unknowns(segments, slack_mm, place_mm, up, glued)
        self._mean = np.array([u.mean for u in self.unknowns])
        self.deviation = np.array([u.deviation for u in self.unknowns])
        self._groups = _groups(self.unknowns)
        clocked = [int(u.of) - 1 for u in self.unknowns if u.kind == "clocking"]
        self._clocked = np.eye(len(segments))[clocked]
        self._lower = np.tri(len(segments))
        self._pulls = np.array([u.kind in _PULLING for u in self.unknowns])
        self.frame = np.eye(3), np.zeros(3)
        """Rotation and place of the base in the frame of the measurement, before ``turn``."""

    def values(self, score: Array) -> Array:
        """Parameters of scores, (parameter - mean) / deviation of the prior, both (..., P)."""
        values: Array = self._mean + self.deviation * score
        dead = self._groups["dead_travel"]
        values[..., dead] = np.abs(values[..., dead])
        return values

    def group(self, score: Array, name: str) -> Array:
        """The parameters whose names begin with this one, in order, (..., number)."""
        return self.values(score)[..., self._groups[name]]

    def robot(self, score: Array) -> MarkedRobot:
        """The robot that the parameters stand for, or several robots, (..., P)."""
        values = self.values(score)
        of = {name: values[..., numbers] for name, numbers in self._groups.items()}
        radius_mm, lengths_mm, sag = of["tendon_radius"], of["length"], of["sag"]
        clocking_rad = of["clocking"] @ self._clocked
        angle_rad = self._angle_rad + of["angle"][..., None] + clocking_rad[..., None, :]
        towards = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)
        at_mm = self._passes * radius_mm[..., None, :]
        own_mm = radius_mm[..., self.segment_of]
        at_end = np.zeros_like(lengths_mm)
        at_end[..., -1] = of["tip_share"].sum(axis=-1)
        places_mm = self._markers.offset_mm + of["marker"][..., None, :]
        places_mm = np.repeat(places_mm, len(self._markers.ends), axis=-2)
        glue_mm = of["glue"]
        places_mm[..., :-1, :] += glue_mm.reshape(*glue_mm.shape[:-1], -1, 3)
        stiffness = np.ones_like(lengths_mm)
        stiffness[..., 1:] = np.exp(of["log_stiffness"])
        softening = (radius_mm * sag)[..., None, :] / radius_mm[..., None]
        return MarkedRobot(
            lengths_mm=lengths_mm,
            freedom=self.freedom,
            stiffness=stiffness,
            lever_mm=at_mm[..., None] * towards,
            sag_mm=at_mm * sag[..., None, :],
            shorter_mm=SHORTER_BY_SAG * radius_mm * sag,
            softening=2.0 * self._lower * softening,
            slack_mm=of["slack"],
            tendon_stiffness_mm2=np.exp(-of["log_compliance"])[..., self.segment_of] / own_mm**2,
            friction_per_mm=of["friction"].sum(axis=-1, keepdims=True) / radius_mm[..., :1],
            load_mm=of["weight"],
            weights=Weights(
                at_end,
                lengths_mm / lengths_mm.sum(axis=-1, keepdims=True),
                at_end[..., -1:] * places_mm[..., -1, :],
            ),
            ends=self._markers.ends,
            places_mm=places_mm,
            turn=self._turn(of["turn"]),
            origin_mm=self.frame[1] + of["base"],
        )

    def half_dead_mm(self, score: Array) -> Array:
        """Half the dead travel of each tendon, (..., T)."""
        return 0.5 * self.group(score, "dead_travel")[..., self.segment_of]

    def travel_mm(self, score: Array, wound_mm: Array) -> Array:
        """Pull of each tendon behind its dead travel, (N, ..., T): the play operator over all rows.

        Args:
            score: of the robot, or of several, (..., P).
            wound_mm: what the motors have wound up at each row, (N, T).
        """
        half_mm, behind, rows = self.half_dead_mm(score), wound_mm[0], []
        for wound in wound_mm:
            behind = pulled_mm(behind, wound, half_mm)
            rows.append(behind)
        return np.array(rows)

    @property
    def nothing(self) -> Array:
        """Scores of the description itself, (P,)."""
        return np.zeros(len(self.unknowns))

    def slopes(
        self,
        score: Array,
        robot: MarkedRobot,
        y: Array,
        travel_of: Callable[[Array], Array],
        numbers: Sequence[int] | None = None,
        anchor_mm: Array | None = None,
        *,
        in_turn: bool = False,
    ) -> Slopes:
        """Derivatives at rest by the implicit function theorem: g(y, p) = 0, dy = -g_y^-1 g_p dp.

        Args:
            score: of the robot.
            robot: the robot itself.
            y: its degrees of freedom at rest, (N, D).
            travel_of: pull of each tendon there by scores, (..., P) -> (N, ..., T).
            numbers: those of the scores by which derivatives are taken; by default all.
            anchor_mm: routes at which dry friction exerts no force, (N, T). What each tendon slid
                beyond it stays the same, but for tendons that stick at rests in turn.
            in_turn: whether rests follow each other; the first one begins without friction.
        """
        chosen = np.arange(len(score)) if numbers is None else np.array(numbers)
        compliance = robot.compliance(y, travel_of(score), anchor_mm)
        here_mm, by_freedom = robot.seen_by(y)
        slid_mm = None if anchor_mm is None else robot.route_mm(y) - anchor_mm
        more, moved = np.zeros((*y.shape, len(chosen))), np.zeros((*here_mm.shape, len(chosen)))
        longer = np.zeros((len(y), len(robot.slack_mm), len(chosen)))
        pulls = self._pulls[chosen]
        for own in (pulls, ~pulls):
            near = score + _PROBE * np.eye(len(score) + 1, len(score))[[-1, *chosen[own]]]
            others = self.robot(near)
            if own is pulls:
                others = replace(others, load_mm=np.zeros(3))
            else:
                moved[..., own] = _by_robot(others.seen_mm(y[:, None]))
            anchors_mm = None
            if slid_mm is not None:
                routes_mm = others.route_mm(y[:, None])
                longer[..., own] = _by_robot(routes_mm)
                anchors_mm = routes_mm - slid_mm[:, None]
            more[..., own] = _by_robot(others.moments(y[:, None], travel_of(near), anchors_mm))
        yielding = -compliance @ more
        if in_turn and slid_mm is not None and robot.rubs:
            yielding = _yielding_in_turn(robot, y, slid_mm, compliance, more, longer)
        markers = moved + by_freedom @ yielding[:, None]
        return Slopes(markers, yielding, by_freedom, compliance)

    def _turn(self, vector: Array) -> Array:
        """The turn from the robot's frame to that of the measurement, (..., 3, 3)."""
        if not vector.shape[-1]:
            return self.frame[0]
        turns = Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix() @ self.frame[0]
        return np.reshape(turns, (*vector.shape[:-1], 3, 3))


def _by_robot(values: Array) -> Array:
    """Derivatives by scores from values of a robot and of those near by, (N, 1 + P, ...)."""
    return np.moveaxis(values[:, 1:] - values[:, :1], 1, -1) / _PROBE


def _yielding_in_turn(
    robot: TendonRobot,
    y: Array,
    slid_mm: Array,
    compliance: Array,
    more: Array,
    longer: Array,
) -> Array:
    """Derivatives of the degrees of freedom by the scores, (N, D, P), of rests in turn.

    A tendon that sticks is held where earlier rests, which depend on the scores too, have left it.

    Args:
        robot: the robot.
        y: degrees of freedom, (N, D).
        slid_mm: routes of the tendons beyond their anchors, (N, T).
        compliance: of the robot there, (N, D, D).
        more: derivatives of the moments where tendons stay as far beyond their anchors, (N, D, P).
        longer: derivatives of the routes at the same bending, (N, T, P).
    """
    sticks, levers_mm = robot.sticking_mm2(slid_mm), robot.levers_mm(y)
    sticks[0], anchor, found = 0.0, np.zeros_like(longer[0]), []
    for row, levers in enumerate(levers_mm):
        held = sticks[row][:, None]
        moments = more[row] + levers.T @ (held * (longer[row] - anchor))
        found.append(-compliance[row] @ moments)
        anchor = np.where(held > 0.0, anchor, longer[row] + levers @ found[-1])
    return np.array(found)


def _unknowns(
    segments: tuple[Segment, ...],
    slack_mm: list[float],
    place_deviation_mm: float,
    up: Array | None,
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
    friction = [Unknown("friction", "", "rad", 0.0, _FRICTION_RAD)]
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
        *(friction if up is not None else []),
        *(Unknown("slack", str(n), "mm", s, 0.6) for n, s in enumerate(slack_mm, 1)),
        *(Unknown("angle", str(n), "rad", 0.0, _HOLES_RAD) for n in range(1, len(slack_mm) + 1)),
        *(Unknown("clocking", n, "rad", 0.0, _HOLES_RAD) for n, _ in named[1:] if up is None),
        *(
            Unknown("weight", axis, "per_mm", mean, weight)
            for axis, mean in zip("xyz", weight_mean.tolist(), strict=True)
        ),
        *(turn if up is None else tip),
        *(Unknown("marker", axis, "mm", 0.0, _MARKERS_MM) for axis in "xyz"),
        *(Unknown("glue", f"{n}_{axis}", "mm", 0.0, _GLUE_MM) for n in glued for axis in "xyz"),
        *(Unknown("base", axis, "mm", 0.0, place_deviation_mm) for axis in "xyz"),
    ]


def _groups(unknowns: list[Unknown]) -> dict[str, slice]:
    """Where those of each kind stand, which follow each other."""
    names = [unknown.kind for unknown in unknowns]
    return {
        name: slice(names.index(name), names.index(name) + names.count(name))
        if name in names
        else slice(0)
        for name in {*names, "clocking", "friction", "log_stiffness", "tip_share", "turn", "glue"}
    }
