"""The constant-curvature model from motor angles to the tip, and its derivatives.

Motors wind tendons, tendons bend segments: with the travel W q of the tendons and the degrees of
freedom y (one per planar segment, two per spatial one), tendons that are taut and do not stretch
ask for A y = W q, with A their levers: r n . b of every segment they pass. y = A^+ W q solves it,
in the measure of the segments' stiffness, for any tendons: what is common to the tendons of a
segment is pretension and bends nothing. For the paper's robot this is (1)-(5), the tip is (10), its
derivatives are (11).

The tip's derivatives are computed along the chain, from its last segment to its first: as y of a
segment turns all that follows, each derivative of a product of transforms is a product of
derivatives, see ``Chain``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.core.arrays import Array, BoolArray, IntArray
from ccr_host.description.schema import Robot, Segment
from ccr_host.robot.chain import (
    MOST_DERIVATIVES,
    PAPER_FRAME,
    bend_of,
    exact_direction,
    exponents,
    planar_functions,
    spatial_functions,
    transform_constants,
)


class Chain(NamedTuple):
    """The constants of a robot, for ``jets``; S segments, D degrees of freedom, n motors.

    The jets of a point are its value and its derivatives, each of which counts how often it is
    differentiated by every coordinate. Those of the point in the frame of segment j are products of
    the transform's by its own coordinates and of the point's by all later ones.
    """

    bending: Array
    """y of the motor angles, transposed, (n, D)."""
    is_planar: BoolArray
    """Which segments are, (S,)."""
    has_planar: bool
    first: IntArray
    """Number of each segment's first coordinate, (S,)."""
    shapes: Sequence[Array]
    """Transforms with derivatives, times the functions of the bending, (functions, all)."""
    kept: Sequence[IntArray]
    """Which products with the jets of the later segments, sorted as ``jet_index`` has them, do not
    exceed the order; all of the last segment's do."""


def freedom_of(segments: Sequence[Segment]) -> Array:
    """Bending vectors of the degrees of freedom, (D, S, 2)."""
    vectors = []
    for number, segment in enumerate(segments):
        planar = [exact_direction(math.radians(segment.direction_deg))]
        for direction in planar if segment.bends == "plane" else [(1.0, 0.0), (0.0, 1.0)]:
            vector = np.zeros((len(segments), 2))
            vector[number] = direction
            vectors.append(vector)
    return np.array(vectors)


def bending_of_motors(robot: Robot) -> Array:
    """Degrees of freedom over motor angles, (D, n), see the module."""
    segments = robot.chain
    freedom = freedom_of(segments)
    tendons = [(number, tendon) for number, s in enumerate(segments) for tendon in s.tendons]
    levers = np.zeros((len(tendons), len(segments), 2))
    wound = np.zeros((len(tendons), max(tendon.motor for _, tendon in tendons)))
    for row, (last, tendon) in enumerate(tendons):
        for number, segment in enumerate(segments[: last + 1]):
            towards = exact_direction(math.radians(tendon.angle_deg + segment.clocking_deg))
            levers[row, number] = np.multiply(segment.tendon_radius_mm, towards)
        wound[row, tendon.motor - 1] = tendon.winding * robot.pulley_radius_mm
    by_freedom = np.tensordot(levers, freedom, axes=((1, 2), (1, 2)))
    stiffness = np.array([segment.stiffness for segment in segments])
    measure = 1.0 / np.sqrt((freedom**2).sum(axis=2) @ stiffness)
    bending: Array = measure[:, None] * (np.linalg.pinv(by_freedom * measure) @ wound)
    # What pinv leaves of products that vanish.
    bending[np.abs(bending) < 1e-12 * np.abs(bending).max()] = 0.0
    return bending


@lru_cache(maxsize=256)
def chain_of(robot: Robot, order: int, start: int = 0, end: int | None = None) -> Chain:
    """The constants of a robot for jets up to an order.

    Args:
        robot: the robot.
        order: of the highest derivatives.
        start: number, from 0, of the first segment; the jets' point is seen from the marker there.
        end: number of the segment after the last one, at whose end the point is; by default all.
    """
    segments = robot.chain[start:end]
    offset = np.array([0.0, robot.marker_offset_mm, 0.0, 1.0])
    base = np.eye(4)
    base[:3, :3] = PAPER_FRAME
    base[:3, 3] = -PAPER_FRAME @ offset[:3]
    sizes: list[int] = []
    shapes, kept = [], []
    later: list[Derivative] = [()]
    for number in reversed(range(len(segments))):
        segment = segments[number]
        is_spatial = segment.bends == "space"
        size = 1 + is_spatial
        direction_rad = None if is_spatial else math.radians(segment.direction_deg)
        shape = transform_constants(direction_rad, segment.length_mm, order)
        if number == 0:
            shape = base[:3] @ shape
        # Functions, then a column of the transform, derivatives, rows: a point times it comes next.
        shape = np.moveaxis(shape, 3, 1)
        if number == len(segments) - 1:
            shape = np.tensordot(offset, shape, axes=(0, 1))
        own = [tuple([0] * i + [1] * j) for i, j in exponents(is_spatial, order)]
        both = [mine + tuple(size + y for y in after) for after in later for mine in own]
        later = list(jet_index(size if not sizes else size + sum(sizes), order))
        place = {product: place for place, product in enumerate(both)}
        sizes.append(size)
        shapes.append(np.ascontiguousarray(shape.reshape(len(shape), -1)))
        kept.append(np.array([place[product] for product in later]))
    first = np.cumsum([0, *sizes[:0:-1]])
    before = len(freedom_of(robot.chain[:start]))
    bending = np.ascontiguousarray(bending_of_motors(robot)[before:][: sum(sizes)].T)
    is_planar = np.array([segment.bends == "plane" for segment in segments])
    has_planar = bool(is_planar.any())
    return Chain(bending, is_planar, has_planar, first, tuple(shapes[::-1]), tuple(kept[::-1]))


Derivative = tuple[int, ...]
"""The coordinates of a derivative, ascending; () is the value."""


@lru_cache(maxsize=64)
def jet_index(coordinates: int, order: int = MOST_DERIVATIVES) -> dict[Derivative, int]:
    """Where jets have the derivative by some coordinates: by ascending order."""
    wanted = [
        chosen
        for number in range(order + 1)
        for chosen in combinations_with_replacement(range(coordinates), number)
    ]
    return {chosen: number for number, chosen in enumerate(wanted)}


@lru_cache(maxsize=64)
def derivative_index(coordinates: int, number: int) -> IntArray:
    """Where jets have every derivative of one order, (coordinates^number,)."""
    index = jet_index(coordinates)
    every = np.ndindex(*[coordinates] * number)
    return np.array([index[tuple(sorted(chosen))] for chosen in every], dtype=np.int64)


def products(left: Array, right: Array) -> Array:
    """Matrix products, (N, i, j) or (i, j) times (N, j, k)."""
    return left @ right


def chosen(rows: Array, numbers: IntArray) -> Array:
    """Rows of each matrix, (N, i, j) -> (N, numbers, j)."""
    return rows.take(numbers, 1)


def jets(chain: Chain, y_rad: Array) -> Array:
    """The tip in the frame of (10) and its derivatives by y, (N, D) -> (N, K, 3).

    In the order of ``jet_index``: the value, the first derivatives, and so on, mm/rad^order.
    """
    poses = len(y_rad)
    waves = planar_functions(y_rad) if chain.has_planar else np.empty((0, poses, 0))
    number = len(chain.shapes) - 1
    columns = _functions(chain, y_rad, waves, number) @ chain.shapes[number]
    point = columns.reshape(poses, -1, 4 if number > 0 else 3)
    while number > 0:
        number -= 1
        shape = _functions(chain, y_rad, waves, number) @ chain.shapes[number]
        both = products(point, shape.reshape(poses, 4, -1))
        point = chosen(both.reshape(poses, -1, 4 if number > 0 else 3), chain.kept[number])
    return point


def _functions(chain: Chain, y_rad: Array, waves: Array, number: int) -> Array:
    """Functions of the bending of one segment, (N, functions)."""
    first = chain.first[number]
    if chain.is_planar[number]:
        own: Array = waves[first]
        return own
    return spatial_functions(y_rad[:, first : first + 2], len(chain.shapes[number]))


class ConstantCurvature:
    """Forward kinematics of any robot.

    ``geometry`` is the controller's model of the robot (Table I, or its segments).
    """

    def __init__(self, geometry: Robot) -> None:
        self._robot = geometry
        self._chains: dict[int, Chain] = {}
        segments = geometry.chain
        self._freedom = freedom_of(segments)
        self.segment_of_freedom = np.nonzero(self._freedom.any(axis=2))[1]
        """Number of the segment that each degree of freedom bends, from 0, (D,)."""
        self._bending = bending_of_motors(geometry)
        self.lengths_mm = tuple(segment.length_mm for segment in segments)
        self.marker_offset_mm = geometry.marker_offset_mm
        self.motors = self._bending.shape[1]
        stiffness = np.array([segment.stiffness for segment in segments])
        of_freedom = (self._freedom**2).sum(axis=2) @ stiffness
        self.energy: Array = (self._bending.T * of_freedom) @ self._bending
        """Twice the energy of the bending over the squares of the motor angles, (n, n), over the
        stiffness of the first segment."""

    def chain(self, order: int = MOST_DERIVATIVES) -> Chain:
        """The constants for ``jets``; kept, as comparing robots takes longer than a pose."""
        if order not in self._chains:
            self._chains[order] = chain_of(self._robot, order)
        return self._chains[order]

    @cached_property
    def _until_marker(self) -> list[Chain]:
        """The first segment, the first two, and so on."""
        ends = range(1, len(self.lengths_mm) + 1)
        return [chain_of(self._robot, 1, end=end) for end in ends]

    def bending_rad(self, q_rad: ArrayLike) -> Array:
        """Degrees of freedom, theta = k L of planar segments (4), (5); (..., n) -> (..., D)."""
        return np.asarray(q_rad, dtype=np.float64) @ self._bending.T

    def markers_mm(self, bending_rad: Array) -> tuple[Array, Array]:
        """Markers relative to M1 and their derivatives by the degrees of freedom.

        Args:
            bending_rad: degrees of freedom of the first segments or of all, (N, D).

        Returns:
            The ends of these segments in the frame of (10), mm, (N, S, 3), and mm/rad,
            (N, S, 3, D).
        """
        poses, freedoms = bending_rad.shape
        parts = [part for part in self._until_marker if part.bending.shape[1] <= freedoms]
        places = np.empty((poses, len(parts), 3))
        slopes = np.zeros((poses, len(parts), 3, freedoms))
        for number, part in enumerate(parts):
            own = part.bending.shape[1]
            jet = jets(part, np.ascontiguousarray(bending_rad[:, :own]))
            places[:, number] = jet[:, 0]
            slopes[:, number, :, :own] = jet[:, 1:].swapaxes(1, 2)
        return places, slopes

    def tip_mm(self, q_rad: ArrayLike) -> Array:
        """Tip's marker relative to M1, f of (10); ``q_rad`` (..., n) -> (..., 3)."""
        return self._jets(q_rad, 0)[..., 0, :]

    def jacobian_mm_rad(self, q_rad: ArrayLike) -> Array:
        """J = df/dq of (11); ``q_rad`` (..., n) -> (..., 3, n)."""
        by_y = self._jets(q_rad, 1)[..., 1:, :]
        return np.swapaxes(by_y, -1, -2) @ self._bending

    def second_order(self, q_rad: ArrayLike) -> tuple[Array, Array, Array]:
        """Tip in mm, (..., 3), and its derivatives by motors, (..., 3, n) and (..., 3, n, n)."""
        derivatives = self.by_motors @ self._jets(q_rad, 2)
        n = self.motors
        square = derivatives[..., n + 1 :, :].reshape(*derivatives.shape[:-2], n, n, 3)
        slopes = np.swapaxes(derivatives[..., 1 : n + 1, :], -1, -2)
        return derivatives[..., 0, :], slopes, np.moveaxis(square, -1, -3)

    @cached_property
    def by_motors(self) -> Array:
        """Value, first and second derivatives by the motors over the jets, (1 + n + n^2, K)."""
        freedoms, turned = len(self._bending), self._bending.T
        own = np.eye(len(jet_index(freedoms, 2)))
        square = np.kron(turned, turned) @ own[derivative_index(freedoms, 2)]
        return np.vstack([own[:1], turned @ own[1 : freedoms + 1], square])

    def backbone_mm(self, q_rad: ArrayLike, points: int = 41) -> Array:
        """Points along the backbone from base to tip, in the frame of (10).

        The origin is marker 1, so the backbone starts at (0, 0, -d_m). ``q_rad`` (..., n) ->
        (..., points, 3), evenly spaced along the length.
        """
        bends = self.bends_rad(self.bending_rad(q_rad))
        ends = np.cumsum(self.lengths_mm)
        along = np.linspace(0.0, ends[-1], points)
        line = np.zeros((*bends.shape[:-2], points, 3))
        line[..., 1] = -self.marker_offset_mm
        turn = np.broadcast_to(np.eye(3), (*bends.shape[:-2], 3, 3))
        for number, length in enumerate(self.lengths_mm):
            share = np.clip((along - (ends[number] - length)) / length, 0.0, 1.0)[:, None]
            here = length * share * bend_of(share * bends[..., number, None, :]).end
            line += here @ np.swapaxes(turn, -1, -2)
            turn = turn @ bend_of(bends[..., number, :]).turn
        turned: Array = line @ PAPER_FRAME.T
        return turned

    def bends_rad(self, bending_rad: Array) -> Array:
        """Bending vector of each segment, as long as its angle; (..., D) -> (..., S, 2)."""
        return np.tensordot(bending_rad, self._freedom, axes=1)

    def disk_turns(self, bending_rad: Array) -> Array:
        """Orientation of the base and of each segment's last disk in the frame of (10).

        The columns of each matrix are the disk's axes: z along the backbone, y towards its marker.
        ``bending_rad`` (D,) -> (S + 1, 3, 3).
        """
        turns = [PAPER_FRAME]
        for turn in bend_of(self.bends_rad(bending_rad)).turn:
            turns.append(turns[-1] @ turn)
        return np.array(turns)

    def _jets(self, q_rad: ArrayLike, order: int) -> Array:
        y = self.bending_rad(q_rad)
        flat = jets(self.chain(order), y.reshape(-1, y.shape[-1]))
        return flat.reshape(*y.shape[:-1], -1, 3)
