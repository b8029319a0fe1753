"""Rests of the robot with what it remembers: backlash, friction of the tendons, and creep.

The first two depend only on how far and in which direction the servos moved, not on their speed.
Segments resist a bend at first by 1 + c times their stiffness: M_j = k_j (theta_j + c (theta_j -
m_j)), where the memory m_j follows theta_j within ``_CREEP_TIME_S``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.loads import Forces
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.statics import (
    STICKING,
    forces_of,
    likely_of,
    settled,
    shafts_of,
    strains_of,
)
from ccr_host.control.adaptive.tip import Tip, markers_of, seen_of, tip_of
from ccr_host.core.arrays import (
    Array,
    IntArray,
    Number,
    Six,
    Three,
    Two,
    positive,
    split,
    stacked,
    within,
)
from ccr_host.robot.rests import Rests

_LONGEST_STEP_RAD = np.radians(8.0)
"""Travel of a motor over which the segments are assumed to move in one direction only."""
_LEAST_BACKLASH_RAD = 1e-4
_FRICTION_1, _CREEP = map(Parameters._fields.index, ("friction_1", "creep"))
_AFTER_FRICTION_1, _AFTER_CREEP = _FRICTION_1 + 1, _CREEP + 1
_CREEP_TIME_S = 5.0
"""Polymers creep on all time scales. This one lies between the 2 s from rest to rest and the tour
of a minute; with 3 or 10 s the camera's turn is found as well (bench/results.md)."""
_UNMOVED_RAD = np.radians(0.1)
"""Demanded reversals of a shaft below this do not take up the whole backlash."""


class Pose(NamedTuple):
    """A pose at rest and what holds it; floats, or arrays if the parameters are arrays.

    ``q`` are the setpoints of the servos; ``lag``, from -1 to 1, is the fraction of their backlash
    by which they lag; ``anchors`` are the strains, see ``strains_of``, at which friction and creep
    exert no force; ``theta`` are the bending angles.
    """

    q_1: Number
    q_2: Number
    lag_1: Number
    lag_2: Number
    anchors: Six
    theta_1: Number
    theta_2: Number

    @property
    def theta(self) -> Two:
        """Bending angles."""
        return self.theta_1, self.theta_2

    @property
    def theta_rad(self) -> Array:
        """Bending angles, (..., 2)."""
        return stacked(*self.theta)


def first_pose(p: Parameters, q_1: Number, q_2: Number) -> Pose:
    """The pose, or poses, at setpoints without a history of motion."""
    guess_1, guess_2 = likely_of(p, q_1, q_2)
    anchors = strains_of(p, guess_1, guess_2)
    shafts = shafts_of(p, (q_1, q_2), (0.0, 0.0))
    theta_1, theta_2 = settled(_remembering(p, 0.0, 0.0), guess_1, guess_2, shafts, anchors)
    return Pose(q_1, q_2, 0.0, 0.0, strains_of(p, theta_1, theta_2), theta_1, theta_2)


def _remembering(p: Parameters, friction: float, creep: float) -> Parameters:
    """The parameters of the same robot with shares of its friction and of its creep."""
    fields: tuple[Number, ...] = (
        *p[:_FRICTION_1],
        friction * p.friction_1,
        *p[_AFTER_FRICTION_1:_CREEP],
        creep * p.creep,
        *p[_AFTER_CREEP:],
    )
    return Parameters(*fields)


def moved(p: Parameters, pose: Pose, q_1: float, q_2: float, duration_s: float = 0.0) -> Pose:
    """The pose after a straight, even motion of the setpoints to new ones, fast by default."""
    steps, travel, kept = _steps_of(q_1 - pose.q_1, q_2 - pose.q_2, duration_s)
    change: Two = 0.0, 0.0
    for _ in range(steps):
        before, pose = pose, stepped(p, pose, travel, change, kept)
        change = _change(before, pose)
    return pose


def _steps_of(travel_1: float, travel_2: float, duration_s: float) -> tuple[int, Two, float]:
    """Short steps of a motion: their number, and what happens in each of them.

    That is the travel of both setpoints, and the share of a new bend that is still new after it.
    """
    steps = math.ceil(max(abs(travel_1), abs(travel_2)) / _LONGEST_STEP_RAD)
    steps = max(steps, 1 if duration_s > 0.0 else 0)
    share = 1.0 / max(steps, 1)
    kept = math.exp(-duration_s * share / _CREEP_TIME_S)
    return steps, (travel_1 * share, travel_2 * share), kept


def turned(p: Parameters, pose: Pose, q_1: float, q_2: float) -> Pose:
    """``moved`` without friction and without updating the bending angles."""
    lag_1 = _lag_of(p.backlash_rad, pose.lag_1, q_1 - pose.q_1)
    lag_2 = _lag_of(p.backlash_rad, pose.lag_2, q_2 - pose.q_2)
    return Pose(q_1, q_2, lag_1, lag_2, pose.anchors, pose.theta_1, pose.theta_2)


def stepped(p: Parameters, pose: Pose, travel: Two, likely: Two, kept: float) -> Pose:
    """The pose after a short motion of the setpoints, with a guess how far the segments bend.

    The memory of creep follows implicitly, so that a long time leaves none of it: what is new is
    kept (theta - m) at the end, which is what resists.
    """
    ahead = turned(p, pose, pose.q_1 + travel[0], pose.q_2 + travel[1])
    shafts = shafts_of(p, (ahead.q_1, ahead.q_2), (ahead.lag_1, ahead.lag_2))
    guess_1, guess_2 = pose.theta_1 + likely[0], pose.theta_2 + likely[1]
    theta_1, theta_2 = settled(_remembering(p, 1.0, kept), guess_1, guess_2, shafts, pose.anchors)
    dragged = _dragged(p, pose.anchors, theta_1, theta_2, kept)
    return Pose(ahead.q_1, ahead.q_2, ahead.lag_1, ahead.lag_2, dragged, theta_1, theta_2)


def _dragged(p: Parameters, anchors: Six, theta_1: Number, theta_2: Number, kept: Number) -> Six:
    """The anchors after a short motion to bending angles, from those before it."""
    route_1, route_2, route_3, route_4, _, _ = strains_of(p, theta_1, theta_2)
    anchor_1, anchor_2, anchor_3, anchor_4, memory_1, memory_2 = anchors
    return (
        route_1 - within(route_1 - anchor_1, STICKING),
        route_2 - within(route_2 - anchor_2, STICKING),
        route_3 - within(route_3 - anchor_3, STICKING),
        route_4 - within(route_4 - anchor_4, STICKING),
        theta_1 - kept * (theta_1 - memory_1),
        theta_2 - kept * (theta_2 - memory_2),
    )


def _change(before: Pose, pose: Pose) -> Two:
    return pose.theta_1 - before.theta_1, pose.theta_2 - before.theta_2


def _lag_of(backlash_rad: Number, lag: Number, travel_rad: float) -> Number:
    """Fraction of the backlash by which a servo lags, -1 to 1, after a further turn."""
    at_least_rad = backlash_rad + positive(_LEAST_BACKLASH_RAD - backlash_rad)
    return within(lag + travel_rad / at_least_rad, 1.0)


def shifted(before: Parameters, after: Parameters, pose: Pose, theta: Array) -> Pose:
    """The pose at the bending angles of a corrected model, (2,): what resists goes on resisting."""
    theta_1, theta_2 = theta.tolist()
    strains = zip(
        pose.anchors,
        strains_of(before, pose.theta_1, pose.theta_2),
        strains_of(after, theta_1, theta_2),
        strict=True,
    )
    one, two, three, four, five, six = (new + (anchor - old) for anchor, old, new in strains)
    anchors = one, two, three, four, five, six
    return pose._replace(anchors=anchors, theta_1=theta_1, theta_2=theta_2)


def setpoint_for(p: Parameters, pose: Pose, shafts: tuple[float, float]) -> Array:
    """Setpoint that turns the shafts from a pose to given angles, including backlash, (2,)."""
    lag, q_rad = np.array([pose.lag_1, pose.lag_2]), np.array([pose.q_1, pose.q_2])
    wanted = np.array([shafts[0] + p.zero_1_rad, shafts[1] + p.zero_2_rad])
    ahead = lag + (wanted - q_rad + p.backlash_rad * lag) / _UNMOVED_RAD
    return np.asarray(wanted + p.backlash_rad * within(ahead, 1.0))


class Slopes(NamedTuple):
    """Forces and tip of a pose, and the motion of the seen tip with each bending angle."""

    forces: Forces
    seen: Three
    by_1: Three
    by_2: Three


def slopes_of(p: Parameters, pose: Pose) -> Slopes:
    """The input of ``change_of`` at a pose."""
    shafts = shafts_of(p, (pose.q_1, pose.q_2), (pose.lag_1, pose.lag_2))
    tip: Tip = tip_of(p, pose.theta_1, pose.theta_2)
    return Slopes(
        forces_of(p, pose.theta_1, pose.theta_2, shafts, pose.anchors),
        seen_of(p, tip.across, tip.sagittal),
        seen_of(p, tip.across_1, tip.sagittal_1),
        seen_of(p, tip.across_2, tip.sagittal_2),
    )


def change_of(
    here: Slopes, near: Parameters, pose: Pose, travel_1: Number, travel_2: Number
) -> tuple[Number, Number, Number, Number, Number]:
    """Changes of tip and bending angles of a pose, by the implicit function theorem.

    At rest g(theta, p) = 0, so dtheta = -g_theta^-1 g_p dp and df = f_p dp + f_theta dtheta. A
    segment held by friction hardly yields. ``near`` are slightly perturbed parameters, ``travel_1``
    and ``travel_2`` perturbations of the setpoints.

    Returns:
        Changes of the seen tip, three, and of the bending angles, two.
    """
    theta_1, theta_2, forces = pose.theta_1, pose.theta_2, here.forces
    q = pose.q_1 + travel_1, pose.q_2 + travel_2
    shafts = shafts_of(near, q, (pose.lag_1, pose.lag_2))
    there = forces_of(near, theta_1, theta_2, shafts, pose.anchors)
    moment_1, moment_2 = there.moment_1 - forces.moment_1, there.moment_2 - forces.moment_2
    k_11, k_12, k_22 = forces.stiffness_11, forces.stiffness_12, forces.stiffness_22
    determinant = k_11 * k_22 - k_12 * k_12
    yielding_1 = (k_12 * moment_2 - k_22 * moment_1) / determinant
    yielding_2 = (k_12 * moment_1 - k_11 * moment_2) / determinant
    tip = tip_of(near, theta_1, theta_2)
    x_mm, y_mm, z_mm = seen_of(near, tip.across, tip.sagittal)
    by_1, by_2 = here.by_1, here.by_2
    return (
        x_mm - here.seen[0] + by_1[0] * yielding_1 + by_2[0] * yielding_2,
        y_mm - here.seen[1] + by_1[1] * yielding_1 + by_2[1] * yielding_2,
        z_mm - here.seen[2] + by_1[2] * yielding_1 + by_2[2] * yielding_2,
        yielding_1,
        yielding_2,
    )


class Moves(NamedTuple):
    """Short, straight motions of the setpoints through rests, T in all.

    ``start_rad`` (2,) are the setpoints before them; ``rows`` (T, 4) have the travel of both
    setpoints, the share of a new bend that is still new after it, and 1 where a motion goes on, 0
    where a new one begins; ``rests`` (N,) count the motions up to each rest.
    """

    start_rad: Array
    rows: Array
    rests: IntArray


def moves_of(rests: Rests) -> Moves:
    """The motions from the first rest's start through all rests."""
    q_1, q_2 = rests.from_rad[0].tolist()
    rows: list[tuple[float, float, float, float]] = []
    counts = []
    stops = np.concatenate([rests.from_rad, rests.q_rad, rests.durations_s()], axis=1)
    for from_1, from_2, to_1, to_2, first_s, then_s in stops.tolist():
        for to, duration_s in (((from_1, from_2), first_s), ((to_1, to_2), then_s)):
            steps, travel, kept = _steps_of(to[0] - q_1, to[1] - q_2, duration_s)
            rows.extend((*travel, kept, float(number > 0)) for number in range(steps))
            q_1, q_2 = to
        counts.append(len(rows))
    return Moves(rests.from_rad[0], np.array(rows).reshape(-1, 4), np.array(counts))


def trail_of(p: Parameters, moves: Moves) -> list[Pose]:
    """The first pose and those after all motions, T + 1, for floats or arrays."""
    pose, change = first_pose(p, *moves.start_rad.tolist()), (0.0, 0.0)
    poses = [pose]
    for travel_1, travel_2, kept, goes_on in moves.rows.tolist():
        likely = goes_on * change[0], goes_on * change[1]
        before, pose = pose, stepped(p, pose, (travel_1, travel_2), likely, kept)
        change = _change(before, pose)
        poses.append(pose)
    return poses


def markers_along(p: Parameters, theta_1: Number, theta_2: Number) -> Array:
    """M2 and M3 in the camera's frame, (..., 2, 3)."""
    middle, tip = markers_of(p, theta_1, theta_2)
    return np.stack([stacked(*middle), stacked(*tip)], axis=-2)


def predicted_mm(p: Parameters, rests: Rests) -> Array:
    """M2 and M3 at the rests, (N, ..., 2, 3), for parameters that are floats or arrays (...)."""
    moves = moves_of(rests)
    poses = trail_of(p, moves)
    theta_1, theta_2 = zip(*(poses[row].theta for row in moves.rests), strict=True)
    return markers_along(p, np.array(theta_1), np.array(theta_2))


def packed(pose: Pose) -> Array:
    """A pose of floats as a vector, (12,)."""
    lags, theta = (pose.lag_1, pose.lag_2), (pose.theta_1, pose.theta_2)
    return np.array((pose.q_1, pose.q_2, *lags, *pose.anchors, *theta))


def unpacked(flat: Array) -> Pose:
    """The pose, or the poses, of vectors, (..., 12)."""
    q_1, q_2, lag_1, lag_2, *anchors, theta_1, theta_2 = split(flat)
    return Pose(q_1, q_2, lag_1, lag_2, tuple(anchors), theta_1, theta_2)


_REMEMBERED, _BENDING = slice(2, 10), slice(10, 12)
"""Lags and anchors, and bending angles, of a packed pose."""
_STATES = 8
_PROBES = _STATES + 2 + 1
"""Further robots for ``slopes_along``: one for each number that a pose remembers, one for each of
its bending angles, and the unchanged one."""
_PROBE = 1e-7
"""Increase of scores, and of what a pose remembers, for derivatives: across a kink they are wrong,
and tendons that stick may be within 1e-6 rad of sliding."""


def probing(scores: Array) -> Array:
    """The scores of the robots that ``slopes_along`` needs, from those of one, (COUNT,)."""
    return scores + _PROBE * np.eye(len(scores) + _PROBES, len(scores))


def slopes_along(near: Parameters, trail: Array, moves: Moves) -> tuple[Array, Array]:
    """M2 and M3 at the rests, (N, 2, 3), and their derivatives by the scores, (N, 2, 3, COUNT).

    Each motion is differentiated by all that it starts from, all motions at once. The forces remain
    zero, which tells the change of the bending angles (the implicit function theorem), and that
    tells the change of what is remembered. Both then follow from motion to motion.

    Args:
        near: parameters of the ``probing`` scores.
        trail: poses of the unchanged robot, packed, (T + 1, 12).
        moves: its motions.
    """
    count = len(near.gain_1) - _PROBES
    probes = np.zeros((count + _PROBES, 12))
    probes[count:-1, 2:] = _PROBE * np.eye(_PROBES - 1)
    before = trail[:-1, None] + probes
    before[..., _BENDING] = trail[1:, None, _BENDING] + probes[:, _BENDING]
    slope = np.swapaxes(_differences(_outcome(near, unpacked(before), moves)), 1, 2)
    by_start, by_bending = np.split(slope, [count + _STATES], axis=2)
    bending = -np.linalg.solve(by_bending[:, :2], by_start[:, :2])
    memory = by_start[:, 2:] + by_bending[:, 2:] @ bending
    first = _first_slopes(near, moves)
    remembered, changes = first[_REMEMBERED], [first[_BENDING]]
    for bent, kept in zip(bending, memory, strict=True):
        changes.append(bent[:, :count] + bent[:, count:] @ remembered)
        remembered = kept[:, :count] + kept[:, count:] @ remembered
    theta_1, theta_2 = split(trail[moves.rests][:, None, _BENDING] + probes[:, _BENDING])
    markers_mm = markers_along(near, theta_1, theta_2)
    by_all = np.moveaxis(_differences(markers_mm), 1, -1)
    change = np.array(changes)[moves.rests][:, None]
    return markers_mm[:, -1], by_all[..., :count] + by_all[..., count + _STATES :] @ change


def _differences(rows: Array) -> Array:
    """Derivatives by all that is probed, (N, K, ...), from (N, K + 1, ...)."""
    return np.asarray((rows[:, :-1] - rows[:, -1:]) / _PROBE)


def _outcome(p: Parameters, before: Pose, moves: Moves) -> Array:
    """What motions lead to: moments, zero at rest, lags and anchors, (T, K, 10).

    ``before`` are the poses before the motions, (T, K), but for the bending angles after them.
    """
    travel_1, travel_2, kept, _ = moves.rows.T[..., None]
    ahead = turned(p, before, before.q_1 + travel_1, before.q_2 + travel_2)
    shafts = shafts_of(p, (ahead.q_1, ahead.q_2), (ahead.lag_1, ahead.lag_2))
    theta, anchors = (before.theta_1, before.theta_2), before.anchors
    forces = forces_of(_remembering(p, 1.0, kept), *theta, shafts, anchors)
    lags = ahead.lag_1, ahead.lag_2
    return stacked(*forces[:2], *lags, *_dragged(p, anchors, *theta, kept))


def _first_slopes(near: Parameters, moves: Moves) -> Array:
    """Derivatives of the first pose, packed, (12, COUNT)."""
    first = first_pose(near, *moves.start_rad.tolist())
    flat = stacked(*first[:4], *first.anchors, *first[5:])
    return _differences(flat[None])[0, : 1 - _PROBES].T
