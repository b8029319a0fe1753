"""The static model's recurring computations as machine code, by numba (extra ``fast``).

The formulas are the compiled ones of the plain model; this module adds the loops that replace its
arrays. It is imported only if a robot description requires it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from types import ModuleType
from typing import NamedTuple, cast

import numpy as np
from numba.extending import overload
from numba.np.unsafe.ndarray import to_fixed_tuple

from ccr_host.control import jit
from ccr_host.control.adaptive import (
    loads,
    motion,
    parameters,
    path_plan,
    statics,
    tip,
)
from ccr_host.control.adaptive.model import PlainModel
from ccr_host.control.adaptive.motion import (
    Moves,
    Pose,
    change_of,
    first_pose,
    markers_along,
    moves_of,
    packed,
    slopes_of,
    stepped,
    unpacked,
)
from ccr_host.control.adaptive.motion import moved as moved_to
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.parameters import FIELDS, Parameters
from ccr_host.control.adaptive.path_plan import polished_of
from ccr_host.control.adaptive.static_model import PROBE, Sensitivity
from ccr_host.control.adaptive.tip import markers_of
from ccr_host.core import arrays
from ccr_host.core.arrays import Array
from ccr_host.robot import arc
from ccr_host.robot.arc import Arc, arc_at_one
from ccr_host.robot.rests import Rests

_SOURCES: tuple[ModuleType, ...] = (
    arc,
    arrays,
    parameters,
    tip,
    loads,
    statics,
    motion,
    path_plan,
)


# Versions for floats of functions that depend on the type of their arguments.
def _arc_at(theta_rad: float) -> Callable[[float], Arc]:
    return arc_at_one


overload(arc.arc_at)(_arc_at)
overload(arrays.largest)(lambda x: lambda x: x if x > 0.0 else -x)
overload(arrays.anywhere)(lambda x: lambda x: x)
_to_fixed_tuple = cast(Callable[[Array, int], tuple[float, ...]], to_fixed_tuple)

_BY_TYPE = arc.arc_at, arrays.largest, arrays.anywhere

for _function in jit.functions_of(*_SOURCES):
    if _function not in _BY_TYPE:
        jit.callable_when_compiled(_function)


class CompiledModel(PlainModel):
    """``PlainModel``, its longer computations in machine code.

    It is compiled, or loaded from the cache, when constructed, never when used.
    """

    def __init__(self) -> None:
        self._entries = _ready_entries()

    def moved(self, p: Parameters, pose: Pose, duration_s: float, *setpoints_rad: Array) -> Pose:
        flat, each_s = packed(pose), duration_s / len(setpoints_rad)
        for setpoint_rad in setpoints_rad:
            flat = self._entries.moved(np.array(p), flat, np.array(setpoint_rad), each_s)
        return unpacked(flat)

    def sensitivity(
        self,
        space: ParameterSpace[Parameters],
        score: Array,
        numbers: Sequence[int],
        p: Parameters,
        pose: Pose,
        rate_rad_s: Array,
    ) -> Sensitivity:
        near = _contiguous(np.array(self._near(space, score, numbers)).T)
        columns = self._entries.changes(near, packed(pose), PROBE * rate_rad_s) / PROBE
        return Sensitivity(columns[:3], columns[3:])

    def predicted_mm(self, p: Parameters, rests: Rests) -> Array:
        moves, rows = moves_of(rests), np.array(p).T
        trails = [self._trail(Parameters(*row), moves) for row in np.atleast_2d(rows)]
        theta = np.array([trail[moves.rests, 10:] for trail in trails]).T
        markers_mm = markers_along(p, theta[0], theta[1])
        return markers_mm if rows.ndim > 1 else markers_mm[:, 0]

    def _trail(self, p: Parameters, moves: Moves) -> Array:
        start_rad, rows = _contiguous(moves.start_rad), _contiguous(moves.rows)
        return self._entries.trail(np.array(p), start_rad, rows)

    def tip_mm(self, p: Parameters, theta_rad: Array) -> Array:
        return self._entries.tip(np.array(p), _contiguous(theta_rad))

    def polished(self, p: Parameters, theta_rad: Array, target_mm: Array, iterations: int) -> Array:
        theta = _contiguous(theta_rad.reshape(-1, 2))
        target = _contiguous(target_mm.reshape(-1, 3))
        found = self._entries.polished(np.array(p), theta, target, iterations)
        return found.reshape(theta_rad.shape)


class _Entries(NamedTuple):
    """The functions that Python calls; arguments are few and flat, as each costs time in numba."""

    moved: jit.Entry[Array]
    changes: jit.Entry[Array]
    trail: jit.Entry[Array]
    tip: jit.Entry[Array]
    polished: jit.Entry[Array]


def _make_entries(fingerprint: int) -> _Entries:
    """The entries, which enclose a fingerprint of all code that they use, see ``jit``."""

    def moved(row: Array, flat: Array, setpoint_rad: Array, duration_s: float) -> Array:
        _ = fingerprint
        p, pose = _parameters(row), _pose(flat)
        return packed(moved_to(p, pose, setpoint_rad[0], setpoint_rad[1], duration_s))

    def changes(near: Array, flat: Array, travel_rad: Array) -> Array:
        _ = fingerprint
        pose, last = _pose(flat), len(near) - 1
        here = slopes_of(_parameters(near[last]), pose)
        columns = np.empty((5, len(near)))
        for i in range(len(near)):
            share = 1.0 if i == last else 0.0
            travel_1, travel_2 = share * travel_rad[0], share * travel_rad[1]
            columns[:, i] = change_of(here, _parameters(near[i]), pose, travel_1, travel_2)
        return columns

    def trail(row: Array, start_rad: Array, rows: Array) -> Array:
        _ = fingerprint
        p, (likely_1, likely_2) = _parameters(row), (0.0, 0.0)
        pose = first_pose(p, start_rad[0], start_rad[1])
        flat = np.empty((len(rows) + 1, 12))
        flat[0] = packed(pose)
        for i in range(len(rows)):
            travel, goes_on, before = (rows[i, 0], rows[i, 1]), rows[i, 3], pose
            likely = goes_on * likely_1, goes_on * likely_2
            pose = stepped(p, pose, travel, likely, rows[i, 2])
            likely_1, likely_2 = pose.theta_1 - before.theta_1, pose.theta_2 - before.theta_2
            flat[i + 1] = packed(pose)
        return flat

    def tip(row: Array, theta_rad: Array) -> Array:
        _ = fingerprint
        _, end = markers_of(_parameters(row), theta_rad[0], theta_rad[1])
        return np.array(end)

    def polished(row: Array, theta_rad: Array, target_mm: Array, iterations: int) -> Array:
        _ = fingerprint
        p, found = _parameters(row), theta_rad.copy()
        for i in range(len(found)):
            x_mm, wanted = target_mm[i, 0], complex(-target_mm[i, 1], target_mm[i, 2])
            found[i] = polished_of(p, found[i, 0], found[i, 1], x_mm, wanted, iterations)
        return found

    entries: tuple[Callable[..., Array], ...] = moved, changes, trail, tip, polished
    return _Entries(*(jit.compiled_on_disk(entry) for entry in entries))


@lru_cache(maxsize=1)
def _ready_entries() -> _Entries:
    """Compiled or loaded by first calls; they then reject arguments of other types."""
    entries = _make_entries(jit.fingerprint(*_SOURCES, jit, sys.modules[__name__]))
    anything = np.full(FIELDS, 0.1)
    pose, pair, pairs = np.zeros(12), np.zeros(2), np.zeros((1, 2))
    entries.moved(anything, pose, pair, 0.1)
    entries.changes(anything[None].copy(), pose, pair)
    entries.trail(anything, pair, np.zeros((1, 4)))
    entries.tip(anything, pair)
    entries.polished(anything, pairs, np.zeros((1, 3)), 1)
    for entry in entries:
        entry.disable_compile()
    return entries


def _contiguous(array: Array) -> Array:
    """A writable copy in C order, the only one that the entries accept."""
    return np.array(array, order="C")


@jit.compiled
def _pose(flat: Array) -> Pose:
    anchors = flat[4], flat[5], flat[6], flat[7], flat[8], flat[9]
    return Pose(flat[0], flat[1], flat[2], flat[3], anchors, flat[10], flat[11])


@jit.compiled
def _parameters(row: Array) -> Parameters:
    return Parameters(*_to_fixed_tuple(row, FIELDS))
