"""Static model of any robot on tendons: rests, their derivatives, and their inverse.

Segments bend evenly by the degrees of freedom theta, (D,), of ``robot.tendon_rest``, whose energy
is least at rest. Backlash is the play of ``RestModel``; dry friction holds tendons at anchors that
they drag along.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from ccr_host.control.adaptive.chain_space import ChainParameters, ChainSpace
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.static_model import Hold, PathPlan, Sensitivity, StaticModel
from ccr_host.core.arrays import Array, IntArray
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.tendon_rest import TendonRobot, pulled_mm
from ccr_host.robot.workspace import MotorLimits

_TOUR_FIRST, _TOUR_PER_FREEDOM = 12, 4
"""Number of rests of the tour, and how many more each degree of freedom takes."""
_TOUR_BENDING_RAD, _TOUR_WHOLE_RAD = np.radians(100.0), np.radians(220.0)
"""Most bending of a segment in each direction, and of all segments together."""
_SHRINKING, _SHRINKINGS = 0.9, 20
"""Bending out of the motors' reach is reduced, so often at most."""
_EVENNESS = 1e-7
"""Weight of the squared tensions beside that of the moments' errors, mm^2: it decides between
tensions that hold the same pose, and leaves opposite tendons just taut."""
_MOST_PULL = 1.5
"""Pull of the tendons chosen over that of all tendons. Four random robots mostly had 1.1 at most;
where it was 3 to 38, tendons worked against each other, and the tip was up to 124 mm off."""
_CORRECTIONS, _LEAST_SHARE, _HELD = 20, 0.01, 1e-6
"""Newton's steps to the setpoints of a pose, by at least this share, and the moments over k_1 that
may remain."""
_SLACK_RANK, _MOST_PIVOTS = 1e-6, 1000
_SLACKENED_MM = -1e6
"""Pull at which no tendon is taut."""
_LEAST_DEAD_MM = 1e-9
"""Smaller dead travel and stretch are none."""
_REST_RAD = 1e-5
"""Newton's method ends with a step below this: the next one would be about its square."""
_UNMOVED_RAD = np.radians(0.1)
"""Demanded reversals of a shaft below this do not take up the whole backlash."""
_PLANNING_STEPS, _FOLLOWING_STEPS = 30, 6
_DAMPING_MM2 = 20.0
"""More than the curvature of targets that are out of reach by a millimetre."""
_RETURN_MM2 = 1.0
"""Pull towards the planned bending among poses that are equally near."""
_LONGEST_STEP_RAD = 0.2


class ChainPose(NamedTuple):
    """A pose at rest."""

    setpoint_rad: Array
    """(n,)."""
    travel_mm: Array
    """Pull of each tendon, behind the setpoints by backlash, (T,)."""
    anchor_mm: Array
    """Routes at which dry friction exerts no force, (T,)."""
    theta_rad: Array
    """Degrees of freedom, (D,)."""


class ChainStatics(StaticModel[ChainParameters, ChainPose]):
    """The static model of any robot."""

    def __init__(self, description: Description, space: ChainSpace) -> None:
        self._space = space
        self._model = space.model
        self._nominal = ConstantCurvature(description.robot)
        self._winding_mm = space.winding_mm
        self._segments = len(description.robot.chain)

    def first_pose(self, p: ChainParameters, setpoint_rad: Array) -> ChainPose:
        travel_mm = self._winding_mm @ setpoint_rad
        theta_rad = p.rest.rest(travel_mm[None])[0]
        return ChainPose(setpoint_rad, travel_mm, p.rest.route_mm(theta_rad), theta_rad)

    def moved(
        self, p: ChainParameters, pose: ChainPose, duration_s: float, *setpoints_rad: Array
    ) -> ChainPose:
        for setpoint_rad in setpoints_rad:
            pose = self.turned(p, pose, setpoint_rad)
        return pose if p.rest.rubs else self._settled(p, pose)

    def turned(self, p: ChainParameters, pose: ChainPose, setpoint_rad: Array) -> ChainPose:
        travel_mm = pulled_mm(pose.travel_mm, self._winding_mm @ setpoint_rad, p.half_dead_mm)
        ahead = pose._replace(setpoint_rad=setpoint_rad, travel_mm=travel_mm)
        return self._settled(p, ahead) if p.rest.rubs else ahead

    @staticmethod
    def _settled(p: ChainParameters, pose: ChainPose) -> ChainPose:
        """The pose at rest."""
        anchor_mm = pose.anchor_mm[None]
        theta_rad = p.rest.rest(pose.travel_mm[None], pose.theta_rad[None], _REST_RAD, anchor_mm)
        dragged_mm = p.rest.dragged_mm(theta_rad, anchor_mm)
        return pose._replace(anchor_mm=dragged_mm[0], theta_rad=theta_rad[0])

    def shifted(
        self,
        before: ChainParameters,
        after: ChainParameters,
        pose: ChainPose,
        theta_rad: Array,
    ) -> ChainPose:
        moved_mm = after.rest.route_mm(theta_rad) - before.rest.route_mm(pose.theta_rad)
        return pose._replace(anchor_mm=pose.anchor_mm + moved_mm, theta_rad=theta_rad)

    def tip_mm(self, p: ChainParameters, theta_rad: Array) -> Array:
        tip: Array = p.turn @ p.rest.seen_mm(theta_rad)[-1]
        return tip

    def markers_mm(self, p: ChainParameters, theta_rad: Array) -> Array:
        return p.rest.seen_mm(theta_rad) @ p.turn.T

    def turned_back_mm(self, p: ChainParameters, seen_mm: Array) -> Array:
        return p.turn.T @ seen_mm

    def predicted_mm(self, p: ChainParameters, rests: Rests) -> Array:
        """Those of robots near by are first-order changes of this robot's."""
        stops_rad, rows = rests.stops()
        wound_mm = stops_rad @ self._winding_mm.T
        travel_of = partial(self._model.travel_mm, wound_mm=wound_mm)
        theta_rad, anchors_mm = p.rest.rests_in_turn(travel_of(p.score))
        here_mm = p.rest.seen_mm(theta_rad[rows])
        if p.near is None:
            return here_mm @ p.turn.T
        slopes = self._model.slopes(
            p.score, p.rest, theta_rad, travel_of, anchor_mm=anchors_mm, in_turn=True
        )
        more_mm = np.moveaxis(slopes.markers[rows] @ p.near.steps.T, -1, 1)
        return (here_mm[:, None] + more_mm) @ np.swapaxes(p.near.turns, 1, 2)

    def sensitivity(
        self,
        space: ParameterSpace[ChainParameters],
        score: Array,
        numbers: Sequence[int],
        p: ChainParameters,
        pose: ChainPose,
        rate_rad_s: Array,
    ) -> Sensitivity:
        """Parameters of tendons act by the bending alone, loads bend the segments unevenly, too."""
        theta_rad, travel_mm = pose.theta_rad, pose.travel_mm
        anchor_mm = pose.anchor_mm[None]
        slopes = self._model.slopes(
            p.score, p.rest, theta_rad[None], lambda _: travel_mm, numbers, anchor_mm
        )
        more = p.rest.moments_by_travel(theta_rad, travel_mm) @ self._winding_mm @ rate_rad_s
        in_time = -slopes.compliance[0] @ more
        tip_in_time = slopes.by_freedom[0, -1] @ in_time
        return Sensitivity(
            np.column_stack([slopes.markers[0, -1], tip_in_time]),
            np.column_stack([slopes.yielding[0], in_time]),
        )

    def hold(
        self,
        p: ChainParameters,
        pose: ChainPose,
        theta_rad: Array,
        sides: tuple[float, ...],
        change_over: tuple[float, ...],
    ) -> Hold:
        """Tendons that need not pull are just taut if a motor winds them alone."""
        balance = _Balance(p.rest, theta_rad, pose.anchor_mm)
        tendons, tension = self._tendons(balance, sides, change_over)
        shafts_rad = self._shafts_rad(balance, tendons, tension)
        setpoints = []
        for motor, tendon in enumerate(tendons):
            wound_mm, half_mm = self._winding_mm[tendon, motor], p.half_dead_mm[tendon]
            behind_mm, needed_mm = pose.travel_mm[tendon], wound_mm * shafts_rad[motor]
            lag_mm = wound_mm * pose.setpoint_rad[motor] - behind_mm
            ahead = lag_mm / max(half_mm, _LEAST_DEAD_MM)
            ahead += (needed_mm - behind_mm) / (abs(wound_mm) * _UNMOVED_RAD)
            setpoints.append((needed_mm + half_mm * np.clip(ahead, -1.0, 1.0)) / wound_mm)
        held = np.sign(self._winding_mm[tendons, range(len(tendons))])
        return Hold(np.array(setpoints), tuple(held.tolist()))

    def unhindered_rad(self, p: ChainParameters, theta_rad: Array) -> Array:
        free = (0.0,) * self._winding_mm.shape[1]
        rows = theta_rad.reshape(-1, theta_rad.shape[-1])
        balances = [_Balance(p.rest, row) for row in rows]
        shafts = [self._shafts_rad(each, *self._tendons(each, free, free)) for each in balances]
        return np.array(shafts).reshape(*theta_rad.shape[:-1], len(free))

    def nearest(
        self,
        p: ChainParameters,
        planned_rad: Array,
        shift_rad: Array,
        aim_mm: Array,
    ) -> Array:
        start_rad, planned = (planned_rad + shift_rad)[None], planned_rad[None]
        found = self._polished(p, start_rad, planned, aim_mm[None], _FOLLOWING_STEPS)
        return found.reshape(-1)

    def plan(
        self, p: ChainParameters, limits: MotorLimits, reference: Reference, knots: Array
    ) -> PathPlan:
        """Near the configurations of the reference, between which effort and limits decided."""
        steps = knots.astype(int)
        planned_rad = self._nominal.bending_rad(reference.q_rad[steps])
        targets_mm = reference.target_mm[steps]
        found = self._polished(p, planned_rad, planned_rad, targets_mm, _PLANNING_STEPS)
        return PathPlan(knots, found)

    def tour_rad(self, p: ChainParameters, limits: MotorLimits) -> Array:
        """Bending spread evenly over all degrees of freedom, in an order of short moves."""
        from scipy.stats import qmc  # noqa: PLC0415 - takes 0.2 s, which other robots need not wait

        freedoms = self._model.freedom.shape[0]
        number = _TOUR_FIRST + _TOUR_PER_FREEDOM * freedoms
        shares = 2.0 * qmc.Halton(freedoms, scramble=False).random(number + 1)[1:] - 1.0
        most_rad = min(_TOUR_BENDING_RAD, _TOUR_WHOLE_RAD / self._segments)
        stops = []
        for share in shares:
            theta_rad, q_rad = most_rad * share, np.full_like(limits.lower_rad, np.inf)
            for _ in range(_SHRINKINGS):
                q_rad = self.unhindered_rad(p, theta_rad)
                if np.array_equal(limits.clip(q_rad), q_rad):
                    break
                theta_rad = _SHRINKING * theta_rad
            stops.append(limits.clip(q_rad))
        ordered, here = [], np.zeros_like(stops[0])
        while stops:
            here = stops.pop(int(np.argmin([np.abs(stop - here).max() for stop in stops])))
            ordered.append(here)
        return np.array(ordered)

    def _polished(
        self,
        p: ChainParameters,
        start_rad: Array,
        planned_rad: Array,
        target_mm: Array,
        steps: int,
    ) -> Array:
        """Damped Gauss-Newton towards the poses nearest to points, (N, D), (N, 3)."""
        theta = start_rad
        damping = np.diag(np.full(theta.shape[1], _DAMPING_MM2 + _RETURN_MM2))
        for _ in range(steps):
            seen_mm, by_seen = p.rest.seen_by(theta)
            tip_mm, by_theta = seen_mm[:, -1], by_seen[:, -1]
            transposed = np.swapaxes(by_theta, 1, 2)
            slope = (transposed @ (tip_mm - target_mm)[:, :, None])[:, :, 0]
            slope += _RETURN_MM2 * (theta - planned_rad)
            step = np.linalg.solve(transposed @ by_theta + damping, slope[:, :, None])[:, :, 0]
            theta = theta - np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD)
        return theta

    def _tendons(
        self, balance: _Balance, sides: tuple[float, ...], change_over: tuple[float, ...]
    ) -> tuple[IntArray, Array]:
        """The tendon by which each motor holds a pose, (n,), and their ``tensions``.

        It is the one that pulls more if all of them may, or on the side that has pulled so far.
        Where these pull much more than all of them would, single motors change sides.
        """
        lever_mm = np.abs(balance.rest.lever_mm).max(axis=(1, 2))
        pull, ways = balance.tensions(np.arange(len(lever_mm))) * lever_mm, []
        for wound, side, most in zip(self._winding_mm.T, sides, change_over, strict=True):
            first, second = np.flatnonzero(wound > 0.0), np.flatnonzero(wound < 0.0)
            pulls = pull[first].max(initial=-1.0), pull[second].max(initial=-1.0)
            is_first = pulls[0] >= pulls[1]
            if side > 0.0 and len(first):
                is_first = pulls[1] <= max(most, pulls[0])
            elif side < 0.0 and len(second):
                is_first = pulls[0] > max(most, pulls[1])
            both = (first, second) if is_first else (second, first)
            ways.append([way[np.argmax(pull[way])] for way in both if len(way)])
        motors, enough = np.arange(len(ways)), _MOST_PULL * pull.max() + max(change_over)

        def held_by(tendons: IntArray) -> tuple[float, IntArray, Array]:
            tension = balance.tensions(tendons)
            return (tension * lever_mm[tendons]).max(), tendons, tension

        best = held_by(np.array([way[0] for way in ways]))
        for _ in ways:
            if best[0] <= enough:
                break
            swaps = [
                np.where(motors == motor, tendon, best[1])
                for motor, way in enumerate(ways)
                for tendon in way
            ]
            found = min(map(held_by, swaps), key=itemgetter(0))
            if found[0] >= best[0]:
                break
            best = found
        return best[1], best[2]

    def _shafts_rad(self, balance: _Balance, tendons: IntArray, tension: Array) -> Array:
        """Shaft angles that hold a pose, (n,); tendons that need not pull are just taut.

        By the tendon with which each motor holds it, then corrected for others that are taut, too,
        as those of a pretensioned pair are.
        """
        winding_mm, taken_mm = self._winding_mm, balance.taken_mm
        stiffness_mm2 = balance.rest.tendon_stiffness_mm2
        needed_mm = taken_mm[tendons] + tension / stiffness_mm2[tendons]
        shafts_rad: Array = needed_mm / winding_mm[tendons, range(len(tendons))]
        moments = balance.moments(winding_mm @ shafts_rad)
        share = 1.0
        for _ in range(_CORRECTIONS):
            if np.abs(moments).max() < _HELD or share < _LEAST_SHARE:
                break
            taut = winding_mm @ shafts_rad - taken_mm > _LEAST_DEAD_MM
            idle = ~(taut[:, None] & (winding_mm != 0.0)).any(axis=0)
            # A motor that pulls no tendon is taken to pull on either side, whichever it needs.
            pulls = (taut[:, None] | idle) * winding_mm * stiffness_mm2[:, None]
            step_rad = np.linalg.lstsq(balance.levers_mm.T @ pulls, moments, _SLACK_RANK)[0]
            there_rad = self._taken_up(shafts_rad, step_rad * idle, taken_mm) + share * step_rad
            there = balance.moments(winding_mm @ there_rad)
            if np.abs(there).max() < np.abs(moments).max():
                shafts_rad, moments, share = there_rad, there, 1.0
            else:
                share *= 0.5
        return shafts_rad

    def _taken_up(self, shafts_rad: Array, way_rad: Array, taken_mm: Array) -> Array:
        """Shaft angles, of motors that are to turn one way those at which a tendon is just taut."""
        found = shafts_rad.copy()
        for motor in np.flatnonzero(np.abs(way_rad) > _LEAST_DEAD_MM):
            wound_mm = self._winding_mm[:, motor]
            ahead = np.flatnonzero(wound_mm * way_rad[motor] > 0.0)
            if len(ahead):
                taut_rad = taken_mm[ahead] / wound_mm[ahead]
                found[motor] = taut_rad[np.argmin(np.abs(taut_rad - shafts_rad[motor]))]
        return found


class _Balance:
    """The moments of one robot, ``rest``, at a pose, (D,), over its tendons.

    What dry friction holds counts if the anchors, (T,), are given.
    """

    def __init__(self, rest: TendonRobot, theta_rad: Array, anchor_mm: Array | None = None) -> None:
        self.rest = rest
        nothing = np.zeros(len(rest.slack_mm))
        self.taken_mm = -rest.stretch_mm(theta_rad, nothing)
        """Travel at which each tendon is just taut, (T,)."""
        self.levers_mm = rest.levers_mm(theta_rad)
        """(T, D)."""
        self._free = rest.moments(theta_rad, nothing + _SLACKENED_MM, anchor_mm)

    def moments(self, travel_mm: Array) -> Array:
        """Those left with the tendons pulled so far, (T,) -> (D,)."""
        taut_mm = np.maximum(travel_mm - self.taken_mm, 0.0)
        return self._free - (self.rest.tendon_stiffness_mm2 * taut_mm) @ self.levers_mm

    def tensions(self, tendons: IntArray) -> Array:
        """Least tensions of some tendons that hold the pose, over k_1, 1/mm; 0 or more."""
        system = np.vstack([self.levers_mm[tendons].T, math.sqrt(_EVENNESS) * np.eye(len(tendons))])
        wanted = np.append(self._free, np.zeros(len(tendons)))
        tensions: Array = nnls(system, wanted, maxiter=_MOST_PIVOTS)[0]
        return tensions
