"""The smallest tracking error possible on the twin's static map.

Each cell of the map is split into two flat triangles; the distance of a target from them is exact,
so the floor does not depend on grid points close to the path. The servo rate limits how many cells
a motor can cross in a period, rounded up: the floor within the rate is a lower bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.sim.robot.static_map import StaticMap

Array = NDArray[np.float64]

_BLOCK = 32
"""Successive targets processed at a time; they are close together, so few cells matter."""
_NEAR_MM = 5.0
"""The distance is exact for cells up to this much farther than the nearest one; a lower bound is
used for the rest, which only a forced detour visits."""


@dataclass(frozen=True)
class Floor:
    """Mean distance to the targets, mm."""

    per_step_mm: float
    """Floor with each sample taken independently."""
    within_rate_mm: float
    """Floor over the best motor path that the servos can follow."""


def floor_of(static_map: StaticMap, target_mm: Array, period_s: float, rate_rad_s: Array) -> Floor:
    """The floor of a path on a twin.

    Args:
        static_map: static map of the twin.
        target_mm: desired tip positions, (N, 3).
        period_s: time between targets.
        rate_rad_s: maximum rate of the motors, (2,).
    """
    cells = _Cells(static_map.tip_mm)
    reach = np.array(
        [
            math.ceil(rate * period_s / (axis[1] - axis[0]))
            for rate, axis in zip(
                rate_rad_s, (static_map.axis_1_rad, static_map.axis_2_rad), strict=True
            )
        ]
    )
    least_mm, cell = cells.nearest(target_mm)
    per_step_mm = float(least_mm.mean())
    if (np.abs(np.diff(cell, axis=0)) <= reach).all():
        return Floor(per_step_mm, per_step_mm)
    cost_to_here = np.zeros(cells.shape)
    for point in target_mm:
        cost_to_here = cells.distance_mm(point) + _least_within(cost_to_here, reach)
    return Floor(per_step_mm, float(cost_to_here.min()) / len(target_mm))


def _least_within(cost: Array, reach: NDArray[np.int_]) -> Array:
    """Least cost among the cells up to ``reach`` away along each axis."""
    for axis, width in enumerate(reach):
        window = min(int(width), cost.shape[axis])
        padding = [(0, 0), (0, 0)]
        padding[axis] = (window, window)
        cost = _running_least(np.pad(cost, padding, constant_values=np.inf), 2 * window + 1, axis)
    return cost


def _running_least(cost: Array, width: int, axis: int) -> Array:
    """Running minimum over ``width`` neighbours, by doubling the span."""
    along = np.moveaxis(cost, axis, 0)
    span = 1
    while 2 * span <= width:
        along = np.minimum(along[:-span], along[span:])
        span *= 2
    rest = width - span
    if rest:
        along = np.minimum(along[:-rest], along[rest:])
    return np.moveaxis(along, 0, axis)


class _Cells:
    def __init__(self, tip_mm: Array) -> None:
        corner, by_1, by_2, across = (
            tip_mm[:-1, :-1],
            tip_mm[1:, :-1],
            tip_mm[:-1, 1:],
            tip_mm[1:, 1:],
        )
        self.shape = corner.shape[:2]
        self._triangles = np.stack(
            [np.stack([corner, by_1, by_2], axis=-2), np.stack([across, by_2, by_1], axis=-2)]
        ).reshape(2, -1, 3, 3)
        corners = np.stack([corner, by_1, by_2, across], axis=-2).reshape(-1, 4, 3)
        self._centre = corners.mean(axis=1)
        self._radius = np.linalg.norm(corners - self._centre[:, None], axis=2).max(axis=1)
        # Stored by coordinate: nine times as fast as the norm of rows.
        self._centre_by_axis = np.ascontiguousarray(self._centre.T)

    def nearest(self, points: Array) -> tuple[Array, NDArray[np.int_]]:
        """Distance of each of the points, (N, 3), from the nearest cell, (N,), and cell, (N, 2)."""
        least_mm, cell = np.empty(len(points)), np.empty(len(points), dtype=int)
        for start in range(0, len(points), _BLOCK):
            block = points[start : start + _BLOCK]
            around = self._may_be_nearest(block)
            to_centre = np.linalg.norm(block[:, None] - self._centre[around], axis=2)
            at_most = (to_centre + self._radius[around]).min(axis=1)
            row, column = np.nonzero(to_centre - self._radius[around] <= at_most[:, None])
            distance = self._exact_mm(around[column], block[row])
            for offset in range(len(block)):
                first, last = np.searchsorted(row, (offset, offset + 1))
                best = first + distance[first:last].argmin()
                least_mm[start + offset] = distance[best]
                cell[start + offset] = around[column[best]]
        return least_mm, np.stack(np.unravel_index(cell, self.shape), axis=1)

    def _may_be_nearest(self, points: Array) -> NDArray[np.int_]:
        """Cells that can be the nearest one of any of these points."""
        middle = points.mean(axis=0)
        spread = np.linalg.norm(points - middle, axis=1).max()
        to_centre = self._to_centres_mm(middle)
        at_most = (to_centre + self._radius).min() + 2 * spread
        return np.flatnonzero(to_centre - self._radius <= at_most)

    def distance_mm(self, point: Array) -> Array:
        """Distance of each cell from a point, or a lower bound for cells far away."""
        to_centre = self._to_centres_mm(point)
        bound = to_centre - self._radius
        near = np.flatnonzero(bound < to_centre.min() + _NEAR_MM)
        distance = np.maximum(bound, 0.0)
        distance[near] = self._exact_mm(near, point)
        return np.asarray(distance.reshape(self.shape), dtype=np.float64)

    def _to_centres_mm(self, point: Array) -> Array:
        off = self._centre_by_axis - point[:, None]
        off *= off
        distance: Array = np.sqrt(off[0] + off[1] + off[2])
        return distance

    def _exact_mm(self, cells: NDArray[np.int_], point: Array) -> Array:
        return np.minimum(*(_to_triangles(t[cells], point) for t in self._triangles))


def _to_triangles(triangles: Array, point: Array) -> Array:
    """Distance of one point (3,), or one point each (N, 3), from triangles (N, 3 corners, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    edge_1, edge_2, offset = b - a, c - a, point - a
    g11, g12, g22 = _dot(edge_1, edge_1), _dot(edge_1, edge_2), _dot(edge_2, edge_2)
    h1, h2 = _dot(edge_1, offset), _dot(edge_2, offset)
    determinant = np.maximum(g11 * g22 - g12 * g12, 1e-12)
    u, v = (g22 * h1 - g12 * h2) / determinant, (g11 * h2 - g12 * h1) / determinant
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    in_plane = offset - u[:, None] * edge_1 - v[:, None] * edge_2
    rim = np.minimum.reduce(
        [_to_edges(a, b, point), _to_edges(a, c, point), _to_edges(b, c, point)]
    )
    return np.asarray(np.where(inside, np.linalg.norm(in_plane, axis=1), rim), dtype=np.float64)


def _to_edges(start: Array, end: Array, point: Array) -> Array:
    edge, offset = end - start, point - start
    share = np.clip(_dot(edge, offset) / np.maximum(_dot(edge, edge), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - share[:, None] * edge, axis=1))


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.einsum("ni,ni->n", a, b)
    return product
