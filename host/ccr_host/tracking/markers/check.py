"""Checks that the markers are where they can be on the robot, and are not swapped.

Of a camera that names bodies (tools, tags, devices of a server), positions are trusted, but not
names, which are assigned by people. A robot of the described geometry cannot do the following,
whatever its tendons, its load and the camera:

- Two markers are further apart than the segments between them allow, or, at rest, where no segment
  is bent by more than `_REST_BENDING_RAD`, nearer than such a bending allows.
- At rest M3, or M2 if it is the last, is on the side of M1 opposite to the one on which the
  backbone leaves the base. Further segments may lead anywhere.
- Two markers change places from one sample to the next.

A marker that is far from where it was in the last picture waits for the next one to confirm it, as
phantoms and wrong matches come and go. Many such jumps end the run, and so does an M1 that leaves
its place for some seconds, as the camera and the robot's base stand still.

The tolerance of a distance is `_LENGTH_TOLERANCE` of it (print; sweeps draw as much around a
description), `_GLUE_MM` for each of its two markers, and `_SIGMAS` times the camera's noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from itertools import combinations, permutations

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature, chain_of, freedom_of, jets
from ccr_host.tracking.tracker import Sample

Order = tuple[int, ...]
"""Which of the seen markers are M1, M2 and so on."""

_MOST_MOVED = 3
"""Markers that are exchanged at a time, except for a robot that is named from the other end."""
_LENGTH_TOLERANCE = 0.1
_GLUE_MM = 1.0
_SIGMAS = 4.0
_REST_BENDING_RAD = math.radians(120.0)
"""More than the paper's paths need, as a robot may have been left in such a pose."""
_LEADING = 2
"""Segments over which such a bending does not lead back to the base."""
_MOST_POSES, _FINEST = 14_641, 30
"""Poses of a grid, and steps of 4 deg to either side."""
_REVERSED = 0.34
"""Sine by which M3 is beyond the base: more than even such a bending makes."""
_JUMP_RATIO = 0.3
"""Ratio of the distances to each other's last positions to those to their own, for a jump."""
_JUMP_MM = 20.0
_DRIFT_MM_S = 100.0
"""Speed of a marker. One that goes faster than `_JUMP_MM` and this allow, and comes back, is a
phantom, unless the motors swing."""
_WATCHED, _MOST_JUMPS = 40, 9
"""Pictures among which jumps to and fro are counted, and how many of them end the run."""
_BASE_MM, _BASE_US = 8.0, 3_000_000
"""M1 has been moved if for this time it is further than this, and the noise, from its place."""
_NEAR_MM = 0.25 * _JUMP_MM
"""Change of every coordinate with which no marker has jumped."""
_SAMPLES = 3
_CONFIRMED_US = 300_000
"""This many samples over this time are not outliers."""
_RENAME = (
    "exchange their names: tracker.tool_files, the tags on the robot, or the names in the server"
)
_UNITS_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4}
_LENGTH_ERROR = (2.5, 0.02)
"""Absolute, mm, and relative to the length: glue, print, uneven bending. Random twins showed errors
of up to 2.3 mm."""


class MarkerCheck:
    """Checks each sample before it is used.

    Samples that are not ``in_robot_frame`` may have any direction.
    """

    def __init__(self, description: Description, *, in_robot_frame: bool = True) -> None:
        self._robot = robot = description.robot
        model = ConstantCurvature(robot)
        self._length_mm = sum(model.lengths_mm)
        self._bending_per_rad = np.abs(model.bending_rad(np.eye(model.motors)).T)
        self.names = robot.markers
        """Names of the markers, M1 first."""
        self._as_named: Order = tuple(range(len(robot.markers)))
        self._turned_round = self._as_named[::-1]
        self._exchanges = _exchanges(self._as_named)
        pairs = list(combinations(self._as_named, 2))
        self._from, self._to = np.array(pairs).T
        """The pairs of markers."""
        self._points_away = in_robot_frame
        """Whether M3 must be where the backbone leaves the base for."""
        noise_mm = _SIGMAS * description.tracker.noise_mm
        self._most_away_mm = _BASE_MM + noise_mm
        tolerance_mm = 2 * _GLUE_MM + noise_mm
        least_mm, most_mm = np.array([_extremes_mm(robot, *pair) for pair in pairs]).T
        self._low_mm = least_mm * (1 - _LENGTH_TOLERANCE) - tolerance_mm
        self._high_mm = most_mm * (1 + _LENGTH_TOLERANCE) + tolerance_mm
        self._moves = False
        self._last: Array | None = None
        """(S + 1, 3): markers that fitted."""
        self._last_us = 0
        self._held: Array | None = None
        """(S + 1, 3): markers that have jumped and are not confirmed."""
        self._jumps: deque[bool] = deque(maxlen=_WATCHED)
        """Whether markers had jumped for one picture alone, for each of the last pictures."""
        self.jumped = 0
        """Number of pictures left out since a marker had jumped for that picture alone."""
        self._base_mm: Array | None = None
        """(3,): M1 when the robot began to move."""
        self._base_left_us: int | None = None
        """Time of exposure since which M1 is elsewhere."""
        self._misfits = 0
        self._misfit_since_us = 0

    def robot_moves(self) -> None:
        """Note that the robot has left its rest."""
        self._moves = True
        self._points_away = False
        if self._base_mm is None and self._last is not None:
            self._base_mm = self._last[0]

    def accepts(self, sample: Sample, swung_rad: Callable[[], Array] | None = None) -> bool:
        """Whether a sample can be used; call once for each sample, in order.

        ``swung_rad`` answers how far the motors went to and fro, (n,); None if they rest.

        Raises:
            TrackerError: several in a row do not fit; says which markers are swapped, or what
                else is wrong; or markers jump to and fro, or M1 has left its place.
        """
        markers_mm, last = sample.markers_mm, self._last
        trouble = self.trouble(markers_mm)
        if trouble is None:
            self._misfits = 0
            if last is not None:
                change_mm = np.abs(markers_mm - last)
                if self._held is None and np.fmax.reduce(change_mm, axis=None) < _NEAR_MM:
                    self._jumps.append(False)
                elif not self._is_confirmed(sample, last, swung_rad):
                    return False
            if self._base_mm is not None:
                away_mm = math.dist(markers_mm[0], self._base_mm)
                if away_mm <= self._most_away_mm:
                    self._base_left_us = None
                else:
                    self._require_base(sample.exposed_us, away_mm)
            self._last = markers_mm.copy()
            self._last_us, self._held = sample.exposed_us, None
            if last is not None:
                lost = np.isnan(self._last)
                self._last[lost] = last[lost]
            return True
        if self._misfits == 0:
            self._misfit_since_us = sample.exposed_us
        self._misfits += 1
        lasted_us = sample.exposed_us - self._misfit_since_us
        if self._misfits >= _SAMPLES and lasted_us >= _CONFIRMED_US:
            raise TrackerError(*trouble)
        return False

    def _strange(self, markers_mm: Array, told: str) -> tuple[str, str]:
        """Cause and cure for markers that are not this robot's, or no longer."""
        strange = f"the markers are not those of this robot: {told}"
        units = [unit for unit, mm in _UNITS_MM.items() if self._fits(mm * markers_mm)]
        if units:
            fitting = " or ".join(units)
            return f"{strange}; {fitting} instead of mm would fit", "let the tracker give mm"
        cure = f"check the lengths in [robot], which body is {', '.join(self.names)}, and "
        cure += "tracker.tag_size_mm"
        if self._last is not None:
            cure = "see with ccr-host monitor which one came off, stands still, or is another body"
            cure += "; check robot.marker_offset_mm"
        return strange, cure

    def trouble(self, markers_mm: Array) -> tuple[str, str] | None:
        """Cause and cure if markers, (S + 1, 3), NaN if lost, cannot be this robot's, else None."""
        if (jump := self._jump(markers_mm)) is not None:
            return f"markers {self._shown(jump)} have changed places", _RENAME
        fits, is_reversed = self._fits(markers_mm), self._points_away and _is_reversed(markers_mm)
        if fits and not is_reversed:
            return None
        exchange = self._exchange(markers_mm)
        told = self._told(markers_mm)
        if exchange is not None:
            return f"markers {self._shown(exchange)} are exchanged: {told}", _RENAME
        if not fits:
            return self._strange(markers_mm, told)
        side = self.names[: _LEADING + 1][-1]
        if self._gain_mm(markers_mm, self._turned_round) < -2 * _GLUE_MM:
            return (
                f"the camera is turned: {side} is on the other side of the base than at rest "
                f"({told})",
                "find out how the camera stands: ccr-host register",
            )
        return (
            f"markers {self._shown(self._turned_round)} are exchanged, or the camera is turned: "
            f"{side} is on the other side of the base than at rest ({told})",
            f"{_RENAME}; or find out how the camera stands: ccr-host register",
        )

    def _is_confirmed(
        self, sample: Sample, last: Array, swung_rad: Callable[[], Array] | None
    ) -> bool:
        """Whether the markers are near those of the last picture, or have jumped there before.

        Motors may have led a marker as far as if all that they bend were bent at the base.

        Raises:
            TrackerError: they jump to and fro too often.
        """
        moved_mm = _moved_mm(sample.markers_mm, last)
        passed_s = (sample.exposed_us - self._last_us) * 1e-6
        limit_mm = _JUMP_MM + _DRIFT_MM_S * passed_s
        if swung_rad is not None:
            limit_mm += self._length_mm * float((self._bending_per_rad @ swung_rad()).sum())
        jumps, held = moved_mm > limit_mm, self._held
        if jumps and held is not None and _moved_mm(sample.markers_mm, held) < moved_mm:
            return True
        self._held = sample.markers_mm if jumps else None
        self._jumps.append(held is not None)
        self.jumped += held is not None
        if sum(self._jumps) >= _MOST_JUMPS:
            raise TrackerError(
                f"the markers jump to and fro: {sum(self._jumps)} of the last "
                f"{len(self._jumps)} pictures showed one more than {limit_mm:.0f} mm from where "
                "it was before and after",
                "shade reflections, remove other markers; check the tools' definitions and the "
                "connection of the camera",
            )
        return not jumps

    def _require_base(self, exposed_us: int, away_mm: float) -> None:
        """Raise a TrackerError if M1 has been away from its place for some seconds."""
        if self._base_left_us is None:
            self._base_left_us = exposed_us
        elif exposed_us - self._base_left_us >= _BASE_US:
            raise TrackerError(
                f"{self.names[0]} is {away_mm:.0f} mm from where it was: the camera, the robot's "
                "base or that marker has been moved",
                "fix all three, then find out how the camera stands: ccr-host register",
            )

    def _exchange(self, markers_mm: Array) -> Order | None:
        """Find the swap of names that fits the robot, and its lengths clearly better."""
        fitting = [
            order
            for order in self._exchanges
            if self._fits(markers_mm[list(order)])
            and not (self._points_away and _is_reversed(markers_mm[list(order)]))
        ]
        best = max(fitting, key=lambda order: self._gain_mm(markers_mm, order), default=None)
        if best is None or not self._gain_mm(markers_mm, best) > 2 * _GLUE_MM:
            return None
        return best

    def _gain_mm(self, markers_mm: Array, order: Order) -> float:
        """Amount by which a swap brings the segments closer to their lengths; NaN if unknown."""
        named, exchanged = (
            seen_lengths_mm(markers_mm[list(one)], self._robot) - self._robot.segment_lengths_mm
            for one in (self._as_named, order)
        )
        return float(np.abs(named).sum() - np.abs(exchanged).sum())

    def _fits(self, markers_mm: Array) -> bool:
        """Whether the distances fit the robot; those of lost markers, NaN, always do."""
        distances = _lengths_mm(markers_mm[self._to, :] - markers_mm[self._from, :])
        if np.logical_or.reduce(distances > self._high_mm):
            return False
        return self._moves or not np.logical_or.reduce(distances < self._low_mm)

    def _jump(self, markers_mm: Array) -> Order | None:
        """The markers that are now where others were in the last sample that fitted."""
        if self._last is None:
            return None
        own_mm = _lengths_mm(markers_mm - self._last)
        if np.add.reduce(np.fmax(own_mm, 0.0)) <= _JUMP_MM:
            return None
        moved_mm = _lengths_mm(markers_mm[:, None] - self._last)
        jumps: dict[Order, float] = {}
        for order in self._exchanges:
            others_mm = moved_mm[list(order), self._as_named]
            moved = [place for place in self._as_named if order[place] != place]
            limit_mm = _JUMP_RATIO * (own_mm[moved].sum() - _JUMP_MM)
            if others_mm[moved].sum() < limit_mm:
                jumps[order] = float(np.nansum(others_mm))
        return min(jumps, key=lambda order: jumps[order], default=None)

    def _told(self, markers_mm: Array) -> str:
        distances_mm = _lengths_mm(markers_mm[self._to, :] - markers_mm[self._from, :])
        seen = ", ".join(
            f"{self.names[start]}-{self.names[end]} {distance:.0f} mm"
            for start, end, distance in zip(self._from, self._to, distances_mm, strict=True)
            if not math.isnan(distance)
        )
        described = " and ".join(f"{length:g}" for length in self._robot.segment_lengths_mm)
        return f"{seen}, segments of {described} mm"

    def _shown(self, order: Order) -> str:
        *most, last = (self.names[place] for place in self._as_named if order[place] != place)
        return f"{', '.join(most)} and {last}"


def _exchanges(as_named: Order) -> tuple[Order, ...]:
    """Names given to the wrong markers, in a fixed order."""
    found = {as_named[::-1]}
    for moved in combinations(as_named, min(_MOST_MOVED, len(as_named))):
        for given in permutations(moved):
            order = list(as_named)
            for place, marker in zip(moved, given, strict=True):
                order[place] = marker
            found.add(tuple(order))
    return tuple(sorted(found - {as_named}))


def _extremes_mm(robot: Robot, first: int, end: int) -> tuple[float, float]:
    """Least and greatest distance of two markers over a grid of poses of the segments between.

    Over more than `_LEADING` segments the least one is not used, the greatest is the sum of theirs.
    """
    if end - first > _LEADING:
        ones = (_extremes_mm(robot, place, place + 1) for place in range(first, end))
        return -math.inf, sum(most_mm for _, most_mm in ones)
    freedom = freedom_of(robot.chain[first:end])
    steps = int(_MOST_POSES ** (1.0 / len(freedom))) // 2
    angles = np.linspace(-_REST_BENDING_RAD, _REST_BENDING_RAD, 2 * min(steps, _FINEST) + 1)
    poses = np.stack(np.meshgrid(*[angles] * len(freedom)), axis=-1).reshape(-1, len(freedom))
    bent_rad = np.linalg.norm(np.tensordot(poses, freedom, axes=1), axis=-1).max(axis=-1)
    poses = poses[bent_rad <= _REST_BENDING_RAD * (1.0 + 1e-9)]
    distances_mm = _lengths_mm(jets(chain_of(robot, 0, first, end), poses)[:, 0])
    return float(distances_mm.min()), float(distances_mm.max())


def _is_reversed(markers_mm: Array) -> bool:
    there_mm = markers_mm[: _LEADING + 1][-1] - markers_mm[0]
    return bool(there_mm[1] > _REVERSED * np.linalg.norm(there_mm))


def _moved_mm(now_mm: Array, before_mm: Array) -> float:
    """Greatest motion of a marker relative to M1; both (S + 1, 3), NaN if lost."""
    change_mm = now_mm - before_mm
    return float(np.nanmax(_lengths_mm(change_mm - change_mm[0])))


def _lengths_mm(vectors_mm: Array) -> Array:
    """Norm of each vector, (..., 3); numpy.linalg.norm takes five times as long for so few."""
    lengths: Array = np.sqrt(np.add.reduce(vectors_mm * vectors_mm, axis=-1))
    return lengths


def seen_lengths_mm(markers_mm: Array, robot: Robot) -> Array:
    """Lengths of the segments, mm, (S,), of a robot whose last segment is straight.

    Then the vector from its first marker to its second is the end tangent of the segment before it.
    A circular arc turns its tangents at both ends by the same angle to its chord, so each end
    tangent gives the length and the end tangent of the segment before. The vector between its two
    markers is along the chord, too, and longer or shorter by the turn of the markers' offset. Which
    of these is not observable; the solution closest to the length in the model is returned. Markers
    are M1, M2 and so on, one per row, (S + 1, 3), in any frame.
    """
    vectors = np.diff(markers_mm, axis=0)
    chords_mm = np.linalg.norm(vectors, axis=1)
    directions = vectors / chords_mm[:, None]
    tangent, lengths_mm = directions[-1], np.empty(len(chords_mm))
    for number in reversed(range(len(chords_mm))):
        segment, direction = robot.chain[number], directions[number]
        half_rad = math.acos(float(np.clip(direction @ tangent, -1.0, 1.0)))
        turned_mm = 2.0 * robot.marker_offset_mm * math.sin(half_rad)
        is_spatial = segment.bends == "space"
        if not is_spatial:
            turned_mm *= abs(math.sin(math.radians(segment.direction_deg)))
        ends_mm = (chords_mm[number] + np.array([-turned_mm, turned_mm])) / np.sinc(
            half_rad / np.pi
        )
        nearest_mm = np.clip(segment.length_mm, *ends_mm)
        nearer = np.argmin(np.abs(ends_mm - segment.length_mm))
        lengths_mm[number] = nearest_mm if is_spatial else ends_mm[nearer]
        tangent = 2.0 * (direction @ tangent) * direction - tangent
    return lengths_mm


def wrong_segments(markers_mm: Array, robot: Robot) -> list[int]:
    """Segments, from 0, whose measured length differs from the model; see ``seen_lengths_mm``."""
    absolute_mm, share = _LENGTH_ERROR
    described_mm = np.array(robot.segment_lengths_mm)
    off_mm = np.abs(seen_lengths_mm(markers_mm, robot) - described_mm)
    allowed_mm = absolute_mm + share * described_mm
    return [int(segment) for segment in np.flatnonzero(off_mm > allowed_mm)]
