"""Constant-curvature kinematics of any chain of segments, planar or spatial, with derivatives.

A segment bends evenly by the vector b = (b_x, b_y), the angle |b| towards b in the frame of its
first disk, whose z axis is the backbone's tangent; a planar one by b = theta n with n fixed. With
W the cross product with (-b_y, b_x, 0), x = |b|^2 and the Stumpff functions

    c_0 = cos|b|,    c_k(x) = integral of (1 - s)^(k-1) / (k-1)! cos(|b| s) over s in [0, 1],

its end is at L (c_2 b_x, c_2 b_y, c_1), and its last disk is turned by I + c_1 W + c_2 W^2: the
frame is carried along without twist. The integrals are taken by Gauss's rule, exact to rounding for
the bending that a description allows, so the straight segment is a regular point and nothing is
divided by a bending angle. Every entry of a segment's homogeneous transform, and each of its
derivatives, is linear in a few functions of its bending (``Family``): in exp(i theta s) at the
nodes of a planar segment, where a derivative multiplies by i s, and in b_x^i b_y^j c_k of a spatial
one, where dc_k/dx = (k c_(k+2) - c_(k+1)) / 2. So matrices of constants hold all formulas.

The paper's robot, (1)-(12), is two planar segments that bend along y and along x of this frame, see
``PAPER_FRAME``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccr_host.core.arrays import Array

Exponents = tuple[int, int]
"""How often something is differentiated by b_x and by b_y; of a planar segment by theta, and 0."""

PAPER_FRAME = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Vector of the chain's first frame to the frame of (10): its backbone starts along -y, segment 1
bends to +z, which is y of the chain, and segment 2 to +x."""

MOST_DERIVATIVES = 3
_GAUSS_NODES = 14
"""Exact to rounding up to 600 deg; a description allows 540."""
_gauss = np.polynomial.legendre.leggauss(_GAUSS_NODES)
NODES = np.concatenate([[0.0], 0.5 * (_gauss[0] + 1.0), [1.0]])
"""0 and 1, too: there the waves are 1, and sine and cosine of the bending."""
_MEAN = np.concatenate([[0.0], 0.5 * _gauss[1], [0.0]])
_POWERS = MOST_DERIVATIVES + 3
_STUMPFFS = 2 * MOST_DERIVATIVES + 3
STUMPFF = np.stack(
    [NODES == 1.0]
    + [_MEAN * (1.0 - NODES) ** (k - 1) / math.factorial(k - 1) for k in range(1, _STUMPFFS)]
    + [NODES == 0.0],
    axis=1,
).astype(np.float64)
"""Cosines at the nodes to c_0, c_1, ..., and 1."""


def planar_functions(theta_rad: Array) -> Array:
    """Cosines of each node's share of the bending, then sines, (N, D) -> (D, N, 2 * nodes)."""
    shares = theta_rad.T[:, :, None] * NODES
    return np.concatenate((np.cos(shares), np.sin(shares)), axis=2)


def spatial_functions(bend_rad: Array, count: int) -> Array:
    """b_x^i b_y^j c_k for the first ``TERMS``, (N, 2) -> (N, count)."""
    angles = np.sqrt((bend_rad * bend_rad).sum(1)).reshape(-1, 1)
    stumpff = np.cos(angles * NODES) @ STUMPFF
    powers = np.vander(bend_rad.ravel(), _POWERS, increasing=True).reshape(-1, 2 * _POWERS)
    by_x, by_y, number = TERMS[0, :count], TERMS[1, :count] + _POWERS, TERMS[2, :count]
    functions: Array = powers.take(by_x, 1) * powers.take(by_y, 1) * stumpff.take(number, 1)
    return functions


def exponents(is_spatial: bool, order: int) -> list[Exponents]:
    """The derivatives of a segment up to an order, the value first."""
    if not is_spatial:
        return [(number, 0) for number in range(order + 1)]
    return [(total - j, j) for total in range(order + 1) for j in range(total + 1)]


@lru_cache(maxsize=128)
def transform_constants(direction_rad: float | None, length_mm: float, order: int) -> Array:
    """The constants that make a segment's transform and derivatives of its functions.

    Args:
        direction_rad: direction of bending of a planar segment; None for a spatial one.
        length_mm: length of the backbone.
        order: of the highest derivatives, at most ``MOST_DERIVATIVES``.

    Returns:
        (functions, derivatives in the order of ``exponents``, 4, 4): homogeneous transforms from
        the frame of the last disk to that of the first.
    """
    family = _spatial(length_mm) if direction_rad is None else _planar(direction_rad, length_mm)
    wanted = exponents(direction_rad is None, order)
    count = len(family[0][0].row()) if direction_rad is not None else _TERMS_UP_TO[order]
    constants: Array = np.zeros((count, len(wanted), 4, 4))
    for number, (by_x, by_y) in enumerate(wanted):
        for row, column in np.ndindex(4, 4):
            function = family[row][column].differentiated(by_x, by_y)
            constants[:, number, row, column] = function.row()[:count]
    return constants


class _Waves:
    """A function of a planar segment: the real part of a weighted sum of exp(i theta s)."""

    def __init__(self, weights: NDArray[np.complex128]) -> None:
        self._weights = weights

    def differentiated(self, by_theta: int, _: int) -> _Waves:
        return _Waves(self._weights * (1j * NODES) ** by_theta)

    def row(self) -> Array:
        return np.concatenate([self._weights.real, -self._weights.imag])


class _Polynomial:
    """A function of a spatial segment: a sum of coefficients times b_x^i b_y^j c_k.

    The terms are coefficients by (i, j, k), with k = -1 for 1 in place of c_k.
    """

    def __init__(self, terms: dict[tuple[int, int, int], float]) -> None:
        self.terms = terms

    def differentiated(self, by_x: int, by_y: int) -> _Polynomial:
        function = self
        for axis in [0] * by_x + [1] * by_y:
            function = function._slope(axis)
        return function

    def row(self) -> Array:
        return np.array([self.terms.get((i, j, k), 0.0) for i, j, k in TERMS.T.tolist()])

    def _slope(self, axis: int) -> _Polynomial:
        terms: dict[tuple[int, int, int], float] = {}
        for (i, j, k), coefficient in self.terms.items():
            power = (i, j)[axis]
            less = (i - 1, j, k) if axis == 0 else (i, j - 1, k)
            more = (i + 1, j) if axis == 0 else (i, j + 1)
            if power:
                terms[less] = terms.get(less, 0.0) + power * coefficient
            if k >= 0:
                for number, share in ((k + 2, float(k)), (k + 1, -1.0)):
                    if share:
                        term = (*more, number)
                        terms[term] = terms.get(term, 0.0) + share * coefficient
        return _Polynomial(terms)


def _planar(direction_rad: float, length_mm: float) -> list[list[_Waves]]:
    cosine, sine = exact_direction(direction_rad)
    turning = np.array([[0.0, 0.0, cosine], [0.0, 0.0, sine], [-cosine, -sine, 0.0]])
    one, end = (NODES == 0.0).astype(np.complex128), (NODES == 1.0).astype(np.complex128)
    matrix = np.zeros((4, 4, len(NODES)), np.complex128)
    matrix[:3, :3] = np.multiply.outer(np.eye(3), one)
    matrix[:3, :3] += np.multiply.outer(turning, -1j * end)
    matrix[:3, :3] += np.multiply.outer(turning @ turning, one - end)
    matrix[:3, 3] = np.multiply.outer([cosine, sine, 0.0], -1j * length_mm * _MEAN)
    matrix[2, 3] = length_mm * _MEAN
    matrix[3, 3] = one
    return [[_Waves(entry) for entry in row] for row in matrix]


def _spatial(length_mm: float) -> list[list[_Polynomial]]:
    one = {(0, 0, -1): 1.0}
    along, across = {(0, 0, 1): length_mm}, -1.0
    xy = {(1, 1, 2): across}
    rows = [
        [{**one, (2, 0, 2): -1.0}, xy, {(1, 0, 1): 1.0}, {(1, 0, 2): length_mm}],
        [xy, {**one, (0, 2, 2): -1.0}, {(0, 1, 1): 1.0}, {(0, 1, 2): length_mm}],
        [{(1, 0, 1): -1.0}, {(0, 1, 1): -1.0}, {(0, 0, 0): 1.0}, along],
        [{}, {}, {}, one],
    ]
    return [[_Polynomial(terms) for terms in row] for row in rows]


def _terms_of_spatial_segments(order: int) -> list[tuple[int, int, int]]:
    """The i, j and k that occur in transforms and their derivatives; those of low orders first."""
    functions = [function for row in _spatial(1.0) for function in row]
    derivatives = exponents(is_spatial=True, order=order)
    occurring = (function.differentiated(*by).terms for by in derivatives for function in functions)
    return list(dict.fromkeys(term for terms in occurring for term in terms))


TERMS = np.array(_terms_of_spatial_segments(MOST_DERIVATIVES)).T.copy()
"""A third of all products of powers and c_k up to the highest of each, (3, terms)."""
_TERMS_UP_TO = [len(_terms_of_spatial_segments(order)) for order in range(MOST_DERIVATIVES + 1)]


def exact_direction(angle_rad: float) -> tuple[float, float]:
    """Cosine and sine, exact at right angles."""
    quarters = angle_rad / (0.5 * math.pi)
    if quarters == round(quarters):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    return math.cos(angle_rad), math.sin(angle_rad)


class Bend(NamedTuple):
    """One segment's shape and its derivatives by b_x and b_y, which come last but two or one.

    Of order 0 there are none, instead of 2.
    """

    end: Array
    """End of a segment of length 1, (..., 3)."""
    end_by: Array
    """(..., 2, 3)."""
    turn: Array
    """Rotation from the frame of the last disk to that of the first, (..., 3, 3)."""
    turn_by: Array
    """(..., 2, 3, 3)."""


def bend_of(bend_rad: ArrayLike, order: Literal[0, 1] = 1) -> Bend:
    """Shape of a segment at bending vectors, (..., 2)."""
    b = np.asarray(bend_rad, dtype=np.float64)
    constants = transform_constants(None, 1.0, order)
    functions = spatial_functions(b.reshape(-1, 2), len(constants))
    flat = functions @ constants.reshape(len(constants), -1)
    whole = flat.reshape(*b.shape[:-1], 1 + 2 * order, 4, 4)
    end, turn = whole[..., :3, 3], whole[..., :3, :3]
    return Bend(end[..., 0, :], end[..., 1:, :], turn[..., 0, :, :], turn[..., 1:, :, :])


@dataclass(frozen=True, eq=False)
class Weights:
    """Which points of a chain are added up, and how often each."""

    at_end: Array
    """Weight of the end of each segment, (..., S)."""
    along: Array
    """Weight spread evenly along each segment, (..., S)."""
    tip_offset_mm: Array
    """Added in the frame of the last disk, (..., 3)."""

    @cached_property
    def shares(self) -> tuple[Array, Array]:
        """Weight of each segment's end, of all that it carries, and of its middle, (..., S, 1).

        Weight along a segment acts at the mean of its points, by Simpson's rule.
        """
        carried = np.cumsum((self.at_end + self.along)[..., ::-1], axis=-1)[..., ::-1]
        return (carried - 5.0 / 6.0 * self.along)[..., None], (self.along / 3.0)[..., None]


def point_mm(
    lengths_mm: Array, bend_rad: Array, weights: Weights, shorter_mm: Array
) -> tuple[Array, Array]:
    """Weighted sum of points of chains in the frame of their base, and its derivatives.

    It is the tip for a weight of 1 at the last end alone; with weights in N it is what gravity's
    energy depends on.

    Args:
        lengths_mm: length of each segment, (..., S).
        bend_rad: bending vectors, (..., S, 2), each in the frame in which its segment begins.
        weights: the points.
        shorter_mm: by how much a bending of 1 rad shortens each segment, (..., S), growing with its
            square.

    Returns:
        The sum, (..., 3), and its derivatives, (..., S, 2, 3).
    """
    at_end, at_middle = weights.shares
    end, end_by, turn, turn_by = bend_of(np.multiply.outer((1.0, 0.5), bend_rad))
    unit = at_end * end[0] + at_middle * end[1]
    unit_by = at_end[..., None] * end_by[0] + 0.5 * at_middle[..., None] * end_by[1]
    lengths, shortening = _shortened(lengths_mm, bend_rad, shorter_mm)
    sums = (lengths * unit)[..., None]
    by = lengths[..., None] * unit_by - shortening[..., None] * unit[..., None, :]
    turns = [turn[0, ..., number, :, :] for number in range(sums.shape[-3])]
    beyond = np.broadcast_to(weights.tip_offset_mm[..., None], (*sums.shape[:-3], 3, 1))
    carried = []
    for number in reversed(range(len(turns))):
        carried.append(beyond)
        beyond = sums[..., number, :, :] + turns[number] @ beyond
    by += (turn_by[0] @ np.stack(carried[::-1], axis=-3)[..., None, :, :])[..., 0]
    if len(turns) > 1:
        frames = np.stack(list(accumulate(turns[:-1], np.matmul)), axis=-3)
        by[..., 1:, :, :] = by[..., 1:, :, :] @ np.swapaxes(frames, -1, -2)
    return beyond[..., 0], by


def ends_mm(lengths_mm: Array, bend_rad: Array, shorter_mm: Array) -> list[tuple[Array, Array]]:
    """Place, (..., 3, 1), and turn, (..., 3, 3), of the disk that ends each segment.

    The arguments are those of ``point_mm``.
    """
    whole = bend_of(bend_rad, order=0)
    ways = (_shortened(lengths_mm, bend_rad, shorter_mm)[0] * whole.end)[..., None]
    place, turn = ways[..., 0, :, :], whole.turn[..., 0, :, :]
    ends = [(place, turn)]
    for number in range(1, ways.shape[-3]):
        place = place + turn @ ways[..., number, :, :]
        turn = turn @ whole.turn[..., number, :, :]
        ends.append((place, turn))
    return ends


def _shortened(lengths_mm: Array, bend_rad: Array, shorter_mm: Array) -> tuple[Array, Array]:
    """Lengths of bent segments, (..., S, 1), and what bending takes off them, (..., S, 2)."""
    shortening = shorter_mm[..., None] * bend_rad
    lengths = lengths_mm[..., None] - (shortening * bend_rad).sum(axis=-1, keepdims=True)
    return lengths, 2.0 * shortening
