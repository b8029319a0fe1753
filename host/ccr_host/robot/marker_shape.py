"""Segment lengths measured from three markers, independent of the camera's pose."""

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
    """Lengths of both segments, mm, (2,), of a robot whose segment 2 is straight.

    Then M3 - M2 is the end tangent of segment 1, which a circular arc of any bending angle turns by
    twice the angle between M3 - M2 and M2 - M1. Whether it bends towards the markers or away from
    them is not observable; the solution closer to the length in the model is returned.

    Args:
        markers_mm: M1, M2 and M3, one per row, (3, 3), in any frame.
        robot: geometry in the model.
    """
    first, second = np.diff(markers_mm, axis=0)
    chord_mm, length_2_mm = (float(np.linalg.norm(vector)) for vector in (first, second))
    half_rad = math.acos(float(np.clip(first @ second / (chord_mm * length_2_mm), -1.0, 1.0)))
    offset_mm = 2.0 * robot.marker_offset_mm * math.sin(half_rad)
    believed_mm = robot.segment_lengths_mm[0]
    bent = float(np.sinc(half_rad / np.pi))
    lengths_mm = ((chord_mm + offset_mm) / bent, (chord_mm - offset_mm) / bent)
    length_1_mm = min(lengths_mm, key=lambda length_mm: abs(length_mm - believed_mm))
    return np.array([length_1_mm, length_2_mm])


def wrong_segments(markers_mm: Array, robot: Robot) -> list[int]:
    """Segments (0 or 1) whose measured length differs from the model; see ``seen_lengths_mm``."""
    absolute_mm, share = _TOLERANCE
    off_mm = np.abs(seen_lengths_mm(markers_mm, robot) - robot.segment_lengths_mm)
    allowed_mm = absolute_mm + share * np.array(robot.segment_lengths_mm)
    return [int(segment) for segment in np.flatnonzero(off_mm > allowed_mm)]
