"""Preview tracking on a static model that is identified first and keeps learning."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ccr_host.control.adaptive.estimator import Estimator, LapMemory
from ccr_host.control.adaptive.identification import (
    SETTLED_AFTER_S,
    RestSurvey,
    StaticsFit,
    identification_of,
)
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.static_model import Hold, PathPlan, PoseFollower
from ccr_host.control.adaptive.statics import LEAST_CHANGE_OVER
from ccr_host.control.shell import Law, Measurement, PathView, Plan, Stage, smooth_moves
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Rests, identified_rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

Sides = tuple[float, ...]

_DWELL_S = 2.0
"""Time after a change-over in which the pair changes back only if it clearly has to: the segment
swings for 0.3 s, commands take 0.3 s to follow the estimate, and a load that was freed by mistake
settles within a second."""
_DWELL_CHANGE_OVER = 0.08
"""Moment, in k_1 per radian, by which the other tendon then must have to pull: 5 deg of bending, by
which the segment hangs in the slack if it was right to change back. With half of it, ten random
twins with all effects have nearly twice as many jumps in vain at 20 Hz (bench/results.md)."""


CHANGES_OVER, AGAIN = "changes over to its other tendon", " again"
"""What a command's detail says of a motor."""


class ChangeOver:
    """Holds poses with the tendon that has pulled so far, until the other one has to.

    Just after a pair has changed over the other one must clearly have to: an estimate that is
    disturbed by the jump must not cause the next one.
    """

    def __init__(self, motors: int) -> None:
        self.sides: Sides = (0.0,) * motors
        """The tendon of each pair that pulls: 1 or -1, 0 before the first pose."""
        self.told = ""
        """Which servos jump through their slack with the last pose. Again is soon after another
        jump, which was in vain."""
        self._changed_s = [-math.inf] * motors

    def hold(self, hold_of: Callable[[Sides, Sides], Hold], time_s: float) -> Hold:
        """The setpoints that hold a pose.

        ``hold_of`` is ``StaticModel.hold`` by the sides that have pulled so far and the moments at
        which they change over.
        """
        dwells = [time_s - changed_s < _DWELL_S for changed_s in self._changed_s]
        most = tuple(_DWELL_CHANGE_OVER if it else LEAST_CHANGE_OVER for it in dwells)
        hold = hold_of(self.sides, most)
        jumps = []
        for motor, (side, before) in enumerate(zip(hold.sides, self.sides, strict=True)):
            if before not in (0.0, side):
                jumps.append(f"motor {motor + 1} {CHANGES_OVER}{AGAIN * dwells[motor]}")
                self._changed_s[motor] = time_s
        self.sides, self.told = hold.sides, ", ".join(jumps)
        return hold


_TOUR_REST_S = 0.5
"""Time for the oscillation after a move to decay, and for six samples of a 20 Hz camera."""
_KNOT_PERIOD_S = 0.25
_LONGEST_SHIFT_RAD = 0.5
"""Poses further from the plan would be on another branch."""
_OLDEST_SAMPLE_S = 0.3


class AdaptiveLaw(Law):
    """Identify, plan the branch, then follow with preview and learning.

    Identification uses a tour of rests during the approach, or the rests of the description. On a
    closed path, the offset that the model does not explain is remembered from lap to lap, by phase.

    Every command is the static model's setpoint for the pose nearest to the point of the path at
    which the command will have taken effect, given the estimated offset. Without measurements it
    continues on its estimate.

    Raises:
        ConfigError: the description's rests were measured on another robot, or ``control.solver``
            needs an extra that is not installed.
    """

    name = "adaptive"
    feedback_s = 0.0

    def __init__(self, description: Description) -> None:
        self._limits = MotorLimits.of(description.servo)
        self.settle_s = description.control.settle_s
        self._identified = identified_rests(description)
        self._model, self._space = make_static_model(description)
        self._motors = description.robot.motors

    @property
    def delay_s(self) -> float:
        return self._estimator.delay_s

    @property
    def is_identified(self) -> bool:
        """Whether the description contains the rests, so that the approach needs no tour."""
        return self._identified is not None

    @property
    def rests(self) -> Rests:
        """The rests that the model was fitted to."""
        return self._survey.rests() if self.fit is None else self.fit.rests

    def start(self, path: PathView, history: SetpointHistory) -> None:
        """Reset everything and plan from the prior."""
        super().start(path, history)
        self.fit: StaticsFit[Any] | None = None
        """The fit that the path was planned with; None if the rests were not suitable."""
        self._survey = RestSurvey(np.zeros(self._motors))
        self._is_surveying = True
        self._estimator = Estimator(self._model, self._space, None)
        self._memory = LapMemory(path.reference.lap_steps, path.period_s)
        self._follower: PoseFollower[Any, Any] | None = None
        self._newest_s: float | None = None
        self._plan = self._plan_path()
        self._shift_rad = np.zeros_like(self._plan.theta_rad[0])
        self.change_over = ChangeOver(self._motors)
        """Which tendons pull, and whether that changes."""

    def stages(self) -> Iterator[Stage]:
        """Tour the rests unless they are known, fit the model, move to the first point."""
        here_rad = self.history.at(math.inf)
        found = None
        if self._identified is not None:
            found = identification_of(self._space, self._identified, self._model)
        if found is None:
            self._survey = RestSurvey(here_rad)
            stops_rad, are_rests = self._model.tour(self._estimator.parameters, self._limits)
            self._survey.visit(stops_rad)
            moves_rad = smooth_moves(here_rad, stops_rad, np.where(are_rests, _TOUR_REST_S, 0.0))
            yield Stage("exploring the robot", moves_rad)
            found, here_rad = identification_of(self._space, self.rests, self._model), stops_rad[-1]
            yield Stage("identifying the robot", here_rad[None], is_motion=False)
        while found is not None and found.improve():
            yield Stage("identifying the robot", here_rad[None], is_motion=False)
        self._is_surveying = False
        if found is not None:
            self.fit = found.fit
            self._estimator = Estimator(self._model, self.fit.scaling, self.fit.result())
        self._plan = self._plan_path()
        self._follower = None
        yield from super().stages()

    def first_rad(self) -> Array:
        p, theta_rad = self._estimator.parameters, self._plan.bending_rad(0.0)
        return self._limits.clip(self._model.unhindered_rad(p, theta_rad))

    def observe(self, measurement: Measurement) -> None:
        """Collect rests for the fit, later learn, but not from other moves of the approach.

        Those are faster than the path, so lag would be mistaken for an offset.
        """
        if self._is_surveying and measurement.clock_index is None:
            self._newest_s = measurement.exposed_s
            self._survey.add(self.history, measurement)
        elif measurement.clock_index is not None or (
            measurement.time_s - self.history.resting_since(measurement.time_s) > SETTLED_AFTER_S
        ):
            self._learn(measurement)

    def plan(self, index: float, commanded_rad: Array, time_s: float) -> Plan:
        """Plan the setpoint of the pose nearest to the path, close to the planned pose."""
        estimator, model = self._estimator, self._model
        oldest_s = time_s - _OLDEST_SAMPLE_S
        follower = self._following(oldest_s)
        follower.advance_to(estimator.parameters, oldest_s)
        p = estimator.believed
        expected_mm = estimator.offset_mm + self._memory.at(index)
        aim_mm = self.path.target_mm(index) - model.turned_back_mm(p, expected_mm)
        planned_rad = self._plan.bending_rad(index)
        theta_rad = model.nearest(p, planned_rad, self._shift_rad, aim_mm)
        shift_rad = np.clip(theta_rad - planned_rad, -_LONGEST_SHIFT_RAD, _LONGEST_SHIFT_RAD)
        self._shift_rad = shift_rad
        theta_rad = planned_rad + shift_rad
        pose = follower.ahead(estimator.parameters)
        hold = self.change_over.hold(partial(model.hold, p, pose, theta_rad), time_s)
        setpoint_rad = self._limits.clip(hold.setpoint_rad)
        predicted_mm = model.tip_mm(p, theta_rad) + expected_mm
        return Plan(setpoint_rad, predicted_mm[None], self.change_over.told)

    def _learn(self, measurement: Measurement) -> None:
        """Correct the estimate by a measurement."""
        estimator, time_s = self._estimator, measurement.time_s
        if self._newest_s is not None:
            estimator.elapse(measurement.exposed_s - self._newest_s)
        self._newest_s = measurement.exposed_s
        follower = self._following(time_s)
        pose = follower.advance_to(estimator.parameters, time_s)
        rate_rad_s, jolt_rad = self.history.rate_at(time_s), self.history.jolt_at(time_s)
        modelled_mm = self._model.tip_mm(estimator.parameters, pose.theta_rad)
        seen_mm = measurement.tip_mm - self._remember(measurement, modelled_mm, jolt_rad)
        follower.pose = estimator.correct(pose, modelled_mm, rate_rad_s, jolt_rad, seen_mm)

    def _remember(self, measurement: Measurement, modelled_mm: Array, jolt_rad: float) -> Array:
        """Note the unexplained offset for the next lap; return that of the last laps, (3,)."""
        index = measurement.clock_index
        if index is None:
            return np.zeros(3)
        estimator, memory = self._estimator, self._memory
        gained_mm = memory.turn(index)
        if gained_mm is not None:
            estimator.hand_over(gained_mm)
        memory.note(index, measurement.tip_mm - modelled_mm, estimator.trust(jolt_rad))
        return memory.at(index)

    def _following(self, time_s: float) -> PoseFollower[Any, Any]:
        if self._follower is None:
            p = self._estimator.parameters
            self._follower = PoseFollower(self._model, p, self.history, time_s)
        return self._follower

    def _plan_path(self) -> PathPlan:
        reference = self.path.reference
        stride = max(1, round(_KNOT_PERIOD_S / self.path.period_s))
        knots = np.unique(np.append(np.arange(0.0, len(reference), stride), self.path.last))
        return self._model.plan(self._estimator.parameters, self._limits, reference, knots)
