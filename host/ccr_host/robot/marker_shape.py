"""Segment lengths measured from the markers, independent of the camera's pose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Robot

Array = NDArray[np.float64]

_TOLERANCE = (2.5, 0.02)
"""Absolute, mm, and relative to the length: glue, print, uneven bending. Random twins showed errors
of up to 2.3 mm."""


def seen_lengths_mm(markers_mm: Array, robot: Robot) -> Array:
    """Lengths of the segments, mm, (S,), of a robot whose last segment is straight.

    Then the vector from its first marker to its second is the end tangent of the segment before it.
    A circular arc turns its tangents at both ends by the same angle to its chord, so each end
    tangent gives the length and the end tangent of the segment before. The vector between its two
    markers is along the chord, too, and longer or shorter by the turn of the markers' offset. Which
    of these is not observable; the solution closest to the length in the model is returned.

    Args:
        markers_mm: M1, M2 and so on, one per row, (S + 1, 3), in any frame.
        robot: geometry in the model.
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


def described_lengths_mm(robot: Robot) -> Array:
    """Lengths of the segments in the model, mm, (S,)."""
    return np.array([segment.length_mm for segment in robot.chain])


def wrong_segments(markers_mm: Array, robot: Robot) -> list[int]:
    """Segments, from 0, whose measured length differs from the model; see ``seen_lengths_mm``."""
    absolute_mm, share = _TOLERANCE
    described_mm = described_lengths_mm(robot)
    off_mm = np.abs(seen_lengths_mm(markers_mm, robot) - described_mm)
    allowed_mm = absolute_mm + share * described_mm
    return [int(segment) for segment in np.flatnonzero(off_mm > allowed_mm)]
