"""Fit of ``robot.tendon_rest``'s model to tendon travel and marker positions of any robot.

Unknown are lengths, radii, stiffness and compliance of the segments, sag, dead travel, slack and
place of every tendon, weight, and where the robot stands in the frame of the measurement. Each has
a prior from the description. The fit is scipy's, with exact derivatives at rest by the implicit
function theorem: with g(y, p) = 0, dy = -g_y^-1 g_p dp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Segment
from ccr_host.robot.chain import Weights, point_mm, tip_weights
from ccr_host.robot.tendon_rest import TendonRobot

FloatArray = NDArray[np.float64]

_MODEL_SHARE = 0.015
"""Assumed error of a coordinate, over the length of the robot: what constant curvature leaves on
measured robots (OpenCR v4 1.0 %, v6 1.6 %, fitted to all rows)."""
_ROBUST = 2.0
"""Residuals above this many assumed errors count linearly."""
_MOST_ROWS = 500
"""Rows that are fitted; more are thinned evenly. Neighbouring rows have the same errors."""
_UNLIKE = 0.05
"""Correlation below which the residuals of two rows count as independent."""
_GLUE_MM, _PLACE_MM = 0.5, 5.0
"""Deviation of a marker at the base from its place, and of the origin of other measurements."""
_PROBE = 1e-5
_MOST_STEPS = 40
_ONE_PLANE = 0.17
"""Bending across the main plane over that in it, at most: 10 deg."""


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


class ChainModel:
    """The model of a described robot, in its own frame until it is aligned with a measurement.

    Args:
        segments: as described.
        travel_mm: pull of each motor at all rows, (N, M), in the order in which they were visited.
        markers: what is measured; by default the tip.
    """

    def __init__(
        self,
        segments: tuple[Segment, ...],
        travel_mm: FloatArray,
        markers: Markers | None = None,
    ) -> None:
        self._segments = segments
        self._markers = markers or tip_alone(len(segments))
        tendons = [(j, tendon) for j, s in enumerate(segments) for tendon in s.tendons]
        self._segment_of = np.array([j for j, _ in tendons])
        self._passes = np.arange(len(segments)) <= self._segment_of[:, None]
        self._angle_rad = np.radians([tendon.angle_deg for _, tendon in tendons])
        self._freedom = _freedom(segments)
        winding = np.array([float(tendon.winding) for _, tendon in tendons])
        self._wound_mm = travel_mm[:, [tendon.motor - 1 for _, tendon in tendons]] * winding
        self.length_mm = sum(s.length_mm for s in segments)
        slack_mm = [tendon.slack_mm for _, tendon in tendons]
        place_mm = _GLUE_MM if self._markers.are_from_base else _PLACE_MM
        self.unknowns = _unknowns(segments, slack_mm, place_mm)
        self._mean = np.array([u.mean for u in self.unknowns])
        self.deviation = np.array([u.deviation for u in self.unknowns])
        self._groups = _groups(self.unknowns)
        self._frame = np.eye(3), np.zeros(3)

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
        compliance = np.exp(self.group(score, "log_compliance"))[self._segment_of]
        own_mm = radius_mm[self._segment_of]
        count = len(self._segments)
        return TendonRobot(
            lengths_mm=lengths_mm,
            freedom=self._freedom,
            stiffness=np.exp(np.append(0.0, self.group(score, "log_stiffness"))),
            lever_mm=at_mm[..., None] * towards[:, None],
            sag_mm=at_mm * self.group(score, "sag"),
            slack_mm=self.group(score, "slack"),
            tendon_stiffness_mm2=1.0 / (compliance * own_mm**2),
            load_mm=self.group(score, "weight"),
            weights=Weights(np.zeros(count), lengths_mm / lengths_mm.sum(), np.zeros(3)),
        )

    def travel_mm(self, score: FloatArray) -> FloatArray:
        """Pull of each tendon behind its dead travel, (N, T): the play operator over all rows."""
        half_mm = 0.5 * self.group(score, "dead_travel")[self._segment_of]
        behind = self._wound_mm[0]
        rows: FloatArray = np.empty_like(self._wound_mm)
        for number, wound_mm in enumerate(self._wound_mm):
            behind = np.clip(behind, wound_mm - half_mm, wound_mm + half_mm)
            rows[number] = behind
        return rows

    def predicted_mm(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Markers of some rows in the frame of the measurement, (n, ends, 3)."""
        robot = self.robot(score)
        bend = robot.bend_rad(robot.rest(self.travel_mm(score)[rows]))
        return self._seen(score, robot, bend)

    def bend_rad(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Bending vectors of some rows, (n, S, 2)."""
        robot = self.robot(score)
        return robot.bend_rad(robot.rest(self.travel_mm(score)[rows]))

    def in_one_plane(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the description bends all segments within one plane there, (n,)."""
        sizes = np.linalg.svd(self.bend_rad(self.nothing, rows), compute_uv=False)
        across = sizes[:, 1] if sizes.shape[1] > 1 else np.zeros(len(rows))
        return np.asarray(across <= _ONE_PLANE * sizes[:, 0])

    @property
    def nothing(self) -> FloatArray:
        """Scores of the description itself, (P,)."""
        return np.zeros(len(self.unknowns))

    def slope(self, score: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
        """Derivatives of the markers at rest by the scores, (n, ends, 3, P)."""
        robot, travel_mm = self.robot(score), self.travel_mm(score)[rows]
        y = robot.rest(travel_mm)
        bend = robot.bend_rad(y)
        _, by_bend = self._ends_mm(robot, bend)
        by_y = np.einsum("nesdi,ysd->neiy", by_bend, self._freedom)
        by_y = self.turn(score) @ by_y
        yielding = np.linalg.inv(robot.stiffness_matrix(y, travel_mm))
        here_mm, moments = self._seen(score, robot, bend), robot.moments(y, travel_mm)
        slope = np.empty((*here_mm.shape, len(score)))
        for number, unknown in enumerate(self.unknowns):
            near = score.copy()
            near[number] += _PROBE
            other = self.robot(near)
            led_mm = self.travel_mm(near)[rows] if unknown.kind == "dead_travel" else travel_mm
            more = (other.moments(y, led_mm) - moments) / _PROBE
            moved = -np.einsum("nde,ne->nd", yielding, more)
            seen = (self._seen(near, other, bend) - here_mm) / _PROBE
            slope[..., number] = seen + np.einsum("neiy,ny->nei", by_y, moved)
        return slope

    def _seen(self, score: FloatArray, robot: TendonRobot, bend: FloatArray) -> FloatArray:
        ends_mm, _ = self._ends_mm(robot, bend)
        moved_mm = self._frame[1] + self.group(score, "base")
        seen: FloatArray = ends_mm @ self.turn(score).T + moved_mm
        return seen

    def _ends_mm(self, robot: TendonRobot, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Markers relative to that at the base, (n, ends, 3), and derivatives by the bending."""
        ends, offset_mm = self._markers.ends, self._markers.offset_mm
        places = np.empty((len(bend), len(ends), 3))
        slopes = np.zeros((len(bend), len(ends), *bend.shape[1:], 3))
        for place, end in enumerate(ends):
            until = slice(0, end + 1)
            at_end = tip_weights(end + 1, offset_mm)
            point, by = point_mm(robot.lengths_mm[until], bend[:, until], at_end)
            places[:, place], slopes[:, place, until] = point - offset_mm, by
        return places, slopes

    def turn(self, score: FloatArray) -> FloatArray:
        """The turn from the robot's frame to that of the measurement, (3, 3)."""
        turn: FloatArray = (
            Rotation.from_rotvec(self.group(score, "turn")).as_matrix() @ self._frame[0]
        )
        return turn

    def align(self, seen_mm: FloatArray, rows: NDArray[np.intp]) -> None:
        """Place the robot so that its markers are nearest to those seen, (n, ends, 3)."""
        self._frame = np.eye(3), np.zeros(3)
        expected_mm = self.predicted_mm(self.nothing, rows).reshape(-1, 3)
        seen_mm = seen_mm.reshape(-1, 3)
        is_free = float(not self._markers.are_from_base)
        middle_mm, expected_middle_mm = (
            is_free * points.mean(axis=0) for points in (seen_mm, expected_mm)
        )
        turn, _ = Rotation.align_vectors(seen_mm - middle_mm, expected_mm - expected_middle_mm)
        matrix = turn.as_matrix()
        self._frame = matrix, middle_mm - matrix @ expected_middle_mm


@dataclass(frozen=True, eq=False)
class ChainFit:
    """The fitted model: ``score`` (P,), its ``covariance`` (P, P)."""

    model: ChainModel
    score: FloatArray
    covariance: FloatArray

    def predicted_mm(self, rows: NDArray[np.intp]) -> FloatArray:
        """Markers of some rows, (n, ends, 3)."""
        return self.model.predicted_mm(self.score, rows)

    def turn_covariance(self) -> FloatArray:
        """Covariance of the robot's turn about the axes of the measurement, rad^2, (3, 3)."""
        own = np.array([unknown.kind == "turn" for unknown in self.model.unknowns])
        deviation = self.model.deviation[own]
        covariance: FloatArray = self.covariance[np.ix_(own, own)]
        return covariance * np.outer(deviation, deviation)


def fit_chain(model: ChainModel, seen_mm: FloatArray, rows: NDArray[np.intp]) -> ChainFit:
    """Fit to some rows.

    The covariance counts rows with errors alike as one, and takes the residual for the error of the
    model.

    Args:
        model: the model of all rows.
        seen_mm: measured markers of all rows, (N, ends, 3).
        rows: the rows to fit, in order.
    """
    fitted = _thinned(rows)
    model.align(seen_mm[fitted], fitted)
    assumed_mm = _MODEL_SHARE * model.length_mm
    prior = np.eye(len(model.unknowns))

    def residuals(score: FloatArray) -> FloatArray:
        off_mm = model.predicted_mm(score, fitted) - seen_mm[fitted]
        return np.append(off_mm.ravel() / assumed_mm, score)

    def slope(score: FloatArray) -> FloatArray:
        by_score = model.slope(score, fitted).reshape(-1, len(score))
        return np.concatenate([by_score / assumed_mm, prior])

    found = least_squares(
        residuals,
        model.nothing,
        slope,
        loss="huber",
        f_scale=_ROBUST,
        ftol=1e-5,
        xtol=1e-4,
        max_nfev=_MOST_STEPS,
    )
    off_mm = seen_mm[fitted] - model.predicted_mm(found.x, fitted)
    larger = max(1.0, float((off_mm**2).mean()) / assumed_mm**2)
    by_score = slope(found.x)[: -len(prior)]
    information = by_score.T @ by_score / (larger * _rows_alike(off_mm)) + prior
    return ChainFit(model, found.x, np.asarray(np.linalg.inv(information)))


def _rows_alike(off_mm: FloatArray) -> float:
    """How many successive rows count as one, from the autocorrelation of their residuals."""
    centred = off_mm - off_mm.mean(axis=0)
    power = float((centred**2).sum()) or 1.0
    rows = 1.0
    for lag in range(1, len(off_mm)):
        alike = float((centred[lag:] * centred[:-lag]).sum()) / power
        if alike < _UNLIKE:
            break
        rows += 2.0 * alike
    return rows


def _thinned(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    return rows[:: max(1, -(-len(rows) // _MOST_ROWS))]


def _freedom(segments: tuple[Segment, ...]) -> FloatArray:
    """B of ``tendon_rest``, (D, S, 2)."""
    ways = []
    for number, segment in enumerate(segments):
        plane_rad = np.radians(segment.direction_deg)
        main = np.array([np.cos(plane_rad), np.sin(plane_rad)])
        own = [main] if segment.bends == "plane" else [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
        for way in own:
            ways.append(np.zeros((len(segments), 2)))
            ways[-1][number] = way
    return np.array(ways)


def _unknowns(
    segments: tuple[Segment, ...], slack_mm: list[float], place_deviation_mm: float
) -> list[Unknown]:
    """All parameters with their prior; stiffness and compliance by their logarithms.

    Lengths are known to 5 %, radii to 7 %, tendons' places to 7 deg. The rest are assumptions about
    robots on tendons: a few per cent of a radian of stretch, a millimetre of slack, weight that
    bends by a tenth of a radian.
    """
    named = [(str(number), segment) for number, segment in enumerate(segments, 1)]
    weight = 0.4 / sum(s.length_mm for s in segments)
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
        *(Unknown("weight", axis, "per_mm", 0.0, weight) for axis in "xyz"),
        *(Unknown("turn", axis, "rad", 0.0, 0.1) for axis in "xyz"),
        *(Unknown("base", axis, "mm", 0.0, place_deviation_mm) for axis in "xyz"),
    ]


def _groups(unknowns: list[Unknown]) -> dict[str, NDArray[np.intp]]:
    names = [unknown.kind for unknown in unknowns]
    return {
        name: np.array([i for i, own in enumerate(names) if own == name], dtype=np.intp)
        for name in {*names, "log_stiffness"}
    }
