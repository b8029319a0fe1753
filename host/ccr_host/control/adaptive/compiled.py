"""The static model's recurring computations as machine code, by numba (extra ``fast``).

The formulas are those of the default path, compiled; only loops are written again. Nothing here is
imported before a robot description asks for it.
"""

from __future__ import annotations

import cmath
import hashlib
import inspect
import math
import sys
from functools import lru_cache
from types import ModuleType
from typing import NamedTuple, Protocol, cast

import numpy as np
from numba.extending import overload

from ccr_host.control import jit
from ccr_host.control.adaptive import (
    either,
    motion,
    parameters,
    path_plan,
    sensitivity,
    statics,
    tip,
)
from ccr_host.control.adaptive.either import Arc, arc_at
from ccr_host.control.adaptive.identification import Rests, Scaling
from ccr_host.control.adaptive.motion import LONGEST_STEP_RAD, Rest
from ccr_host.control.adaptive.parameters import FloatArray, Parameters
from ccr_host.control.adaptive.sensitivity import PROBE, Sensitivity
from ccr_host.control.adaptive.statics import STICKING, Drive
from ccr_host.control.jit import callable_when_compiled, compiled, compiled_on_disk
from ccr_host.robot import arc

_SOURCES: tuple[ModuleType, ...] = (
    arc,
    either,
    motion,
    parameters,
    path_plan,
    sensitivity,
    statics,
    tip,
    jit,
)

_arc_derivatives_at = callable_when_compiled(arc.arc_derivatives_at)
overload(either.arc_at)(
    lambda theta: lambda theta: Arc(_arc_derivatives_at(theta), cmath.exp(1j * theta))
)
overload(either.largest)(lambda x: lambda x: x if x > 0.0 else -x)
overload(either.anywhere)(lambda x: lambda x: x)
for _function in (
    either.positive,
    either.sign,
    either.within,
    statics._loads,
    statics._shortfall,
    statics._newton_step,
    statics._searched,
    tip._cross,
    tip._turned,
    tip._turn_of,
    tip._bulge_mm,
):
    callable_when_compiled(_function)
_forces_of = callable_when_compiled(statics.forces_of)
_routes_of = callable_when_compiled(statics.routes_of)
_likely_of = callable_when_compiled(statics.likely_of)
_settled = callable_when_compiled(statics.settled)
_shafts_of = callable_when_compiled(statics.shafts_of)
_lag_of = callable_when_compiled(motion.lag_of)
_tip_of = callable_when_compiled(tip.tip_of)
_seen_of = callable_when_compiled(tip.seen_of)
_nearer = callable_when_compiled(path_plan.nearer)
_within = either.within

_FRICTION_1 = Parameters._fields.index("friction_1")


class _Pose(NamedTuple):
    """A ``Rest``, one by one."""

    q_1: float
    q_2: float
    lag_1: float
    lag_2: float
    anchors: tuple[float, float, float, float]
    theta_1: float
    theta_2: float


class CompiledModel:
    """``PlainModel`` in machine code.

    Building one compiles, or loads what was compiled before; using it never does.
    """

    def __init__(self) -> None:
        self._entries = _ready_entries()

    def moved(self, p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
        return _unpacked(self._entries.moved(np.array(p), _packed(rest), np.array(setpoint_rad)))

    def held_after(self, p: Parameters, rest: Rest, setpoint_rad: FloatArray) -> Rest:
        if p.friction_1 > 0.0:
            return self.moved(p, rest, setpoint_rad)
        return motion.held_after(p, rest, setpoint_rad)

    def sensitivity(
        self, scaling: Scaling, score: FloatArray, rest: Rest, rate_rad_s: FloatArray
    ) -> Sensitivity:
        near = np.array(scaling.perturbed(score, PROBE)).T.copy()
        columns = self._entries.sensitivity(near, _packed(rest), np.array(rate_rad_s))
        return Sensitivity(columns[:3], columns[3:])

    def predicted_mm(self, p: Parameters, rests: Rests) -> FloatArray:
        rows = np.array(p).T
        markers_mm = self._entries.predicted_mm(
            np.atleast_2d(rows).copy(), np.array(rests.start_rad), np.array(rests.setpoint_rad)
        )
        return markers_mm if rows.ndim > 1 else markers_mm[:, 0]

    def polished(
        self, p: Parameters, theta_rad: FloatArray, target_mm: FloatArray, iterations: int
    ) -> FloatArray:
        theta = np.array(theta_rad).reshape(-1, 2)
        target = np.array(target_mm).reshape(-1, 3)
        found = self._entries.polished(np.array(p), theta, target, iterations)
        return found.reshape(theta_rad.shape)


class _Entry(Protocol):
    """A compiled function; array arguments are contiguous and writable floats."""

    def __call__(self, *arguments: FloatArray | int) -> FloatArray: ...

    def disable_compile(self) -> None: ...


class _Entries(NamedTuple):
    """What Python calls; arguments are few and flat since numba takes time to pass each."""

    moved: _Entry
    sensitivity: _Entry
    predicted_mm: _Entry
    polished: _Entry


def _make_entries(fingerprint: int) -> _Entries:
    """Entries that enclose a fingerprint of all code they are made of, see ``make_plan_step``."""

    def moved(packed: FloatArray, rest: FloatArray, setpoint_rad: FloatArray) -> FloatArray:
        _ = fingerprint
        p = _parameters(packed)
        return _flat(_moved(p, _pose(rest), setpoint_rad[0], setpoint_rad[1]))

    def sensitivity(near: FloatArray, rest: FloatArray, rate_rad_s: FloatArray) -> FloatArray:
        _ = fingerprint
        return _columns(near, _pose(rest), rate_rad_s)

    def predicted_mm(rows: FloatArray, start: FloatArray, setpoints: FloatArray) -> FloatArray:
        _ = fingerprint
        markers_mm = np.empty((len(setpoints), len(rows), 2, 3))
        for i in range(len(rows)):
            p = _parameters(rows[i])
            pose = _first(rows[i], start[0], start[1])
            for j in range(len(setpoints)):
                pose = _moved(p, pose, setpoints[j, 0], setpoints[j, 1])
                arc_1, arc_2 = arc_at(pose.theta_1), arc_at(pose.theta_2)
                at = _tip_of(p, pose.theta_1, pose.theta_2, arc_1, arc_2)
                for axis in range(3):
                    markers_mm[j, i, 0, axis] = _seen_of(p, p.middle_aside_mm, at.middle)[axis]
                    markers_mm[j, i, 1, axis] = _seen_of(p, at.across, at.sagittal)[axis]
        return markers_mm

    def polished(
        packed: FloatArray, theta_rad: FloatArray, target_mm: FloatArray, iterations: int
    ) -> FloatArray:
        _ = fingerprint
        p, found = _parameters(packed), theta_rad.copy()
        for i in range(len(found)):
            theta_1, theta_2 = found[i, 0], found[i, 1]
            wanted = complex(-target_mm[i, 1], target_mm[i, 2])
            for _ in range(iterations):
                theta_1, theta_2 = _nearer(p, theta_1, theta_2, target_mm[i, 0], wanted)
            found[i, 0], found[i, 1] = theta_1, theta_2
        return found

    entries = moved, sensitivity, predicted_mm, polished
    return _Entries(*(cast(_Entry, compiled_on_disk(entry)) for entry in entries))


@lru_cache(maxsize=1)
def _entries() -> _Entries:
    sources = "".join(map(inspect.getsource, (*_SOURCES, sys.modules[__name__])))
    return _make_entries(int.from_bytes(hashlib.sha256(sources.encode()).digest()[:7], "big"))


def _ready_entries() -> _Entries:
    """Compiled or loaded by first calls; from then on they refuse arguments of other types."""
    entries = _entries()
    anything = np.full(len(Parameters._fields), 0.1)
    pose, pair, pairs = np.zeros(10), np.zeros(2), np.zeros((1, 2))
    entries.moved(anything, pose, pair)
    entries.sensitivity(anything[None].copy(), pose, pair)
    entries.predicted_mm(anything[None].copy(), pair, pairs)
    entries.polished(anything, pairs, np.zeros((1, 3)), 1)
    for entry in entries:
        entry.disable_compile()
    return entries


def _packed(rest: Rest) -> FloatArray:
    drive, theta_rad = rest
    return np.concatenate((drive.setpoint_rad, drive.lag, drive.anchor, theta_rad))


def _unpacked(flat: FloatArray) -> Rest:
    return Rest(Drive(flat[:2], flat[2:4], flat[4:8]), flat[8:])


@compiled
def _pose(flat: FloatArray) -> _Pose:
    anchors = flat[4], flat[5], flat[6], flat[7]
    return _Pose(flat[0], flat[1], flat[2], flat[3], anchors, flat[8], flat[9])


@compiled
def _flat(pose: _Pose) -> FloatArray:
    flat = np.empty(10)
    flat[0], flat[1], flat[2], flat[3] = pose.q_1, pose.q_2, pose.lag_1, pose.lag_2
    flat[4], flat[5], flat[6], flat[7] = pose.anchors
    flat[8], flat[9] = pose.theta_1, pose.theta_2
    return flat


@compiled
def _parameters(row: FloatArray) -> Parameters:
    return Parameters(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10],
        row[11], row[12], row[13], row[14], row[15], row[16], row[17], row[18], row[19], row[20],
        row[21], row[22], row[23], row[24], row[25], row[26],
    )  # fmt: skip


@compiled
def _first(row: FloatArray, q_1: float, q_2: float) -> _Pose:
    """``first_rest``."""
    p = _parameters(row)
    without_friction = row.copy()
    without_friction[_FRICTION_1] = 0.0
    free = _parameters(without_friction)
    guess_1, guess_2 = _likely_of(p, q_1, q_2)
    anchors = _routes_of(p, guess_1, guess_2)
    shafts = _shafts_of(p, (q_1, q_2), (0.0, 0.0))
    theta_1, theta_2 = _settled(free, guess_1, guess_2, shafts, anchors)
    return _Pose(q_1, q_2, 0.0, 0.0, _routes_of(p, theta_1, theta_2), theta_1, theta_2)


@compiled
def _moved(p: Parameters, pose: _Pose, to_1: float, to_2: float) -> _Pose:
    travel_1, travel_2 = to_1 - pose.q_1, to_2 - pose.q_2
    steps = math.ceil(max(abs(travel_1), abs(travel_2)) / LONGEST_STEP_RAD)
    for _ in range(steps):
        pose = _stepped(p, pose, travel_1 / steps, travel_2 / steps)
    return pose


@compiled
def _stepped(p: Parameters, pose: _Pose, travel_1: float, travel_2: float) -> _Pose:
    q_1, q_2 = pose.q_1 + travel_1, pose.q_2 + travel_2
    lag_1 = _lag_of(p.play_rad, pose.lag_1, travel_1)
    lag_2 = _lag_of(p.play_rad, pose.lag_2, travel_2)
    shafts = _shafts_of(p, (q_1, q_2), (lag_1, lag_2))
    theta_1, theta_2 = _settled(p, pose.theta_1, pose.theta_2, shafts, pose.anchors)
    route_1, route_2, route_3, route_4 = _routes_of(p, theta_1, theta_2)
    anchor_1, anchor_2, anchor_3, anchor_4 = pose.anchors
    anchors = (
        route_1 - _within(route_1 - anchor_1, STICKING),
        route_2 - _within(route_2 - anchor_2, STICKING),
        route_3 - _within(route_3 - anchor_3, STICKING),
        route_4 - _within(route_4 - anchor_4, STICKING),
    )
    return _Pose(q_1, q_2, lag_1, lag_2, anchors, theta_1, theta_2)


@compiled
def _columns(near: FloatArray, pose: _Pose, rate_rad_s: FloatArray) -> FloatArray:
    """Derivatives of tip (3) and bending angles (2) in each score, then in time: (5, COUNT + 1)."""
    here, theta_1, theta_2 = _parameters(near[-1]), pose.theta_1, pose.theta_2
    arc_1, arc_2 = arc_at(theta_1), arc_at(theta_2)
    lags = pose.lag_1, pose.lag_2
    shafts = _shafts_of(here, (pose.q_1, pose.q_2), lags)
    forces = _forces_of(here, theta_1, theta_2, shafts, pose.anchors)
    k_11, k_12, k_22 = forces.stiffness_11, forces.stiffness_12, forces.stiffness_22
    determinant = k_11 * k_22 - k_12 * k_12
    at = _tip_of(here, theta_1, theta_2, arc_1, arc_2)
    seen = _seen_of(here, at.across, at.sagittal)
    by_1 = _seen_of(here, 0.0, at.sagittal_1)
    by_2 = _seen_of(here, at.across_2, at.sagittal_2)
    columns = np.empty((5, len(near)))
    for i in range(len(near)):
        p = _parameters(near[i])
        in_time = PROBE * (i == len(near) - 1)
        q_1, q_2 = pose.q_1 + in_time * rate_rad_s[0], pose.q_2 + in_time * rate_rad_s[1]
        shafts = _shafts_of(p, (q_1, q_2), lags)
        moved = _forces_of(p, theta_1, theta_2, shafts, pose.anchors)
        moment_1, moment_2 = moved.moment_1 - forces.moment_1, moved.moment_2 - forces.moment_2
        yielding_1 = (k_12 * moment_2 - k_22 * moment_1) / determinant
        yielding_2 = (k_12 * moment_1 - k_11 * moment_2) / determinant
        at = _tip_of(p, theta_1, theta_2, arc_1, arc_2)
        direct = _seen_of(p, at.across, at.sagittal)
        for axis in range(3):
            change = direct[axis] - seen[axis] + by_1[axis] * yielding_1 + by_2[axis] * yielding_2
            columns[axis, i] = change / PROBE
        columns[3, i], columns[4, i] = yielding_1 / PROBE, yielding_2 / PROBE
    return columns
