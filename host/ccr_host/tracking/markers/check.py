"""Checks that M1, M2 and M3 are where they can be on the robot, and are not swapped.

Of a camera that names bodies (tools, tags, devices of a server), positions are trusted, but not
names, which are assigned by people. A robot of the described geometry cannot do the following,
whatever its tendons, its load and the camera:

- Two markers are further apart than the segments between them allow, or, at rest, where no segment
  is bent by more than `_REST_BENDING_RAD`, nearer than such a bending allows.
- At rest M3 is on the side of M1 opposite to the one on which the backbone leaves the base.
- Two markers change places from one sample to the next.

The tolerance of a distance is `_LENGTH_TOLERANCE` of it (print; sweeps draw as much around a
description), `_GLUE_MM` for each of its two markers, and `_SIGMAS` times the camera's noise.
"""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.arc import arc_derivatives
from ccr_host.robot.marker_shape import seen_lengths_mm
from ccr_host.tracking.tracker import MARKERS, Sample

Array = NDArray[np.float64]
Order = tuple[int, ...]
"""Which of the three seen markers are M1, M2 and M3."""

_AS_NAMED: Order = (0, 1, 2)
_EXCHANGES: tuple[Order, ...] = tuple(order for order in permutations(_AS_NAMED))[1:]
_TURNED_ROUND: Order = (2, 1, 0)
_FROM, _TO = (0, 1, 0), (1, 2, 2)
"""The three pairs of markers."""

_LENGTH_TOLERANCE = 0.1
_GLUE_MM = 1.0
_SIGMAS = 4.0
_REST_BENDING_RAD = math.radians(120.0)
"""More than the paper's paths need, as a robot may have been left in such a pose."""
_REVERSED = 0.34
"""Sine by which M3 is beyond the base: more than even such a bending makes."""
_JUMP_RATIO = 0.3
"""Ratio of the distances to each other's last positions to those to their own, for a jump."""
_JUMP_MM = 20.0
_SAMPLES = 3
_CONFIRMED_US = 300_000
"""This many samples over this time are not outliers."""
_RENAME = (
    "exchange their names: tracker.tool_files, the tags on the robot, or the names in the server"
)


class MarkerCheck:
    """Checks each sample before it is used.

    Args:
        description: description of the robot and its camera.
        in_robot_frame: whether samples are in the robot's frame; otherwise their direction is not
            checked.
    """

    def __init__(self, description: Description, *, in_robot_frame: bool = True) -> None:
        self._robot = description.robot
        self._points_away = in_robot_frame
        """Whether M3 must be where the backbone leaves the base for."""
        tolerance_mm = 2 * _GLUE_MM + _SIGMAS * description.tracker.noise_mm
        self._low_mm, self._high_mm = _bounds_mm(description.robot, tolerance_mm)
        self._moves = False
        self._last: Array | None = None
        """(3, 3): markers that fitted."""
        self._misfits = 0
        self._misfit_since_us = 0

    def robot_moves(self) -> None:
        """Note that the robot has left its rest."""
        self._moves = True
        self._points_away = False

    def accepts(self, sample: Sample) -> bool:
        """Whether a sample can be used; call once for each sample, in order.

        Raises:
            TrackerError: several in a row do not fit; says which markers are swapped, or what
                else is wrong.
        """
        trouble = self.trouble(sample.markers_mm)
        if trouble is None:
            last, self._last = self._last, sample.markers_mm.copy()
            if last is not None:
                lost = np.isnan(self._last)
                self._last[lost] = last[lost]
            self._misfits = 0
            return True
        if self._misfits == 0:
            self._misfit_since_us = sample.exposed_us
        self._misfits += 1
        lasted_us = sample.exposed_us - self._misfit_since_us
        if self._misfits >= _SAMPLES and lasted_us >= _CONFIRMED_US:
            raise TrackerError(*trouble)
        return False

    def trouble(self, markers_mm: Array) -> tuple[str, str] | None:
        """Cause and cure if markers, (3, 3), NaN if lost, cannot be this robot's, else None."""
        if (jump := self._jump(markers_mm)) is not None:
            return f"markers {_names(jump)} have changed places", _RENAME
        fits, is_reversed = self._fits(markers_mm), self._points_away and _is_reversed(markers_mm)
        if fits and not is_reversed:
            return None
        exchange = self._exchange(markers_mm)
        told = self._told(markers_mm)
        if exchange is not None:
            return f"markers {_names(exchange)} are exchanged: {told}", _RENAME
        if not fits:
            return (
                f"the markers are not those of this robot: {told}",
                "check robot.segment_lengths_mm, which body is M1, M2, M3, and tracker.tag_size_mm",
            )
        if self._gain_mm(markers_mm, _TURNED_ROUND) < -2 * _GLUE_MM:
            return (
                f"the camera is turned: M3 is on the other side of the base than at rest ({told})",
                "find out how the camera stands: ccr-host register",
            )
        return (
            f"markers M1 and M3 are exchanged, or the camera is turned: M3 is on the other side of "
            f"the base than at rest ({told})",
            f"{_RENAME}; or find out how the camera stands: ccr-host register",
        )

    def _exchange(self, markers_mm: Array) -> Order | None:
        """Find the swap of names that fits the robot, and its lengths clearly better."""
        fitting = [
            order
            for order in _EXCHANGES
            if self._fits(markers_mm[list(order)])
            and not (self._points_away and _is_reversed(markers_mm[list(order)]))
        ]
        best = max(fitting, key=lambda order: self._gain_mm(markers_mm, order), default=None)
        if best is None or not self._gain_mm(markers_mm, best) > 2 * _GLUE_MM:
            return None
        return best

    def _gain_mm(self, markers_mm: Array, order: Order) -> float:
        """By how much a swap brings the segments closer to their lengths; NaN if unknown."""
        named, exchanged = (
            seen_lengths_mm(markers_mm[list(one)], self._robot) - self._robot.segment_lengths_mm
            for one in (_AS_NAMED, order)
        )
        return float(np.abs(named).sum() - np.abs(exchanged).sum())

    def _fits(self, markers_mm: Array) -> bool:
        """Whether the distances fit the robot; those of lost markers, NaN, always do."""
        distances = _lengths_mm(markers_mm[_TO, :] - markers_mm[_FROM, :])
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
        for order in _EXCHANGES:
            others_mm = moved_mm[list(order), _AS_NAMED]
            moved = [place for place in _AS_NAMED if order[place] != place]
            limit_mm = _JUMP_RATIO * (own_mm[moved].sum() - _JUMP_MM)
            if others_mm[moved].sum() < limit_mm:
                return order
        return None

    def _told(self, markers_mm: Array) -> str:
        seen = ", ".join(
            f"{MARKERS[start]}-{MARKERS[end]} {distance:.0f} mm"
            for start, end, distance in zip(
                _FROM, _TO, _lengths_mm(markers_mm[_TO, :] - markers_mm[_FROM, :]), strict=True
            )
            if not math.isnan(distance)
        )
        described = " and ".join(f"{length:g}" for length in self._robot.segment_lengths_mm)
        return f"{seen}, segments of {described} mm"


def _bounds_mm(geometry: Robot, tolerance_mm: float) -> tuple[Array, Array]:
    """Least and greatest distances, (3,) each, with both segments bent up to the limit."""
    angles = np.linspace(-_REST_BENDING_RAD, _REST_BENDING_RAD, 121)
    length_1, length_2 = geometry.segment_lengths_mm
    arc, turn = arc_derivatives(angles)[0], np.exp(1j * angles)
    to_2 = length_1 * arc + 1j * geometry.marker_offset_mm * (turn - 1)
    to_3 = to_2[:, None] + length_2 * arc.real * turn[:, None]
    ranges = (np.abs(to_2), length_2 * np.abs(arc), np.hypot(np.abs(to_3), length_2 * arc.imag))
    least, most = (np.array([extreme(one) for one in ranges]) for extreme in (np.min, np.max))
    return (
        least * (1 - _LENGTH_TOLERANCE) - tolerance_mm,
        most * (1 + _LENGTH_TOLERANCE) + tolerance_mm,
    )


def _is_reversed(markers_mm: Array) -> bool:
    tip_mm = markers_mm[2] - markers_mm[0]
    return bool(tip_mm[1] > _REVERSED * np.linalg.norm(tip_mm))


def _lengths_mm(vectors_mm: Array) -> Array:
    """Norm of each vector, (..., 3); numpy.linalg.norm takes five times as long for so few."""
    lengths: Array = np.sqrt(np.add.reduce(vectors_mm * vectors_mm, axis=-1))
    return lengths


def _names(order: Order) -> str:
    *most, last = (MARKERS[place] for place in _AS_NAMED if order[place] != place)
    return f"{', '.join(most)} and {last}"
