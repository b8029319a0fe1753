"""The identification motion: a tour of configurations with a rest at each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MEAN_RATE_RAD_S = np.radians(60.0)
_SHORTEST_MOVE_S = 0.7
"""Two periods of the structure's slowest oscillation, so that the move leaves none behind."""


_ROWS_RAD = np.radians((0.0, 50.0, 100.0, -100.0, -50.0))
_COLUMNS_RAD = np.radians((-110.0, -40.0, 40.0, 110.0))


def tour_bending_rad() -> FloatArray:
    """Bending angles that show all parameters, (N, 2), neighbours next to each other.

    They reach as far as the workspace does: the camera's rotation and the robot's sag can only be
    told apart by large bends.
    """
    stops: list[tuple[float, float]] = []
    for number, row in enumerate(_ROWS_RAD):
        columns = _COLUMNS_RAD if number % 2 == 0 else _COLUMNS_RAD[::-1]
        stops.extend((row, column) for column in columns)
    return np.array(stops)


def tour(start_rad: FloatArray, stops_rad: FloatArray, rest_s: float, tick_s: float) -> FloatArray:
    """Setpoints, one a tick, (N, 2): smooth moves from stop to stop, a rest at each."""
    setpoints = []
    here = start_rad
    for stop in stops_rad:
        farthest = float(np.abs(stop - here).max())
        ticks = int(np.ceil(max(_SHORTEST_MOVE_S, farthest / _MEAN_RATE_RAD_S) / tick_s))
        share = np.arange(1, ticks + 1) / ticks
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        setpoints.append(here + smooth[:, None] * (stop - here))
        setpoints.append(np.repeat(stop[None], int(np.ceil(rest_s / tick_s)), axis=0))
        here = stop
    return np.concatenate(setpoints)
