"""Preview tracking on a static model that is identified first and keeps learning."""

from __future__ import annotations

import enum
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.estimator import Estimator, Tuning
from ccr_host.control.adaptive.excitation import tour
from ccr_host.control.adaptive.identification import Rests, Scaling, StaticsFit
from ccr_host.control.adaptive.identified import identified_rests
from ccr_host.control.adaptive.lap_memory import LapMemory
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.motion import Rest, setpoint_for
from ccr_host.control.adaptive.path_plan import PathPlan, plan_path
from ccr_host.control.adaptive.pose_follower import PoseFollower
from ccr_host.control.adaptive.rest_survey import SETTLED_AFTER_S, RestSurvey, fit_to
from ccr_host.control.adaptive.setpoint_history import SetpointHistory
from ccr_host.control.adaptive.statics import hold_at, unhindered_setpoints_for
from ccr_host.control.adaptive.tip import tip_mm, turned_back_mm
from ccr_host.control.adaptive.tour_stops import tour_stops_rad
from ccr_host.control.base import APPROACH_PERIOD_S, Command, Observation, Outcome, Phase
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]

_TOUR_REST_S = 0.5
"""Time for the last move's motion to die down and for six samples of a 20 Hz camera."""
_LONGEST_RAMP_S = 0.5
_RAMP_SHARE = 0.8
"""Of the period: the ramp of one command ends before the next one begins."""
_KNOT_PERIOD_S = 0.25
_REFINEMENTS = 4
_LONGEST_SHIFT_RAD = 0.5
"""Further from the plan would be another branch."""
_OLDEST_SAMPLE_S = 0.3
_OTHER_COMMAND_RAD = np.radians(0.05)
"""Above the rounding of the link: the loop has repeated an older command instead of the last."""
_US_PER_S = 1e6


class _Phase(enum.Enum):
    SURVEY = "exploring the robot"
    FIT = "identifying the robot"
    TO_FIRST_POINT = "approaching the first point"
    PATH = "following the path"


class AdaptiveStatics:
    """Identify, plan the branch, then follow with preview and learning.

    Identification is a tour of rests during the approach, or that of the description. From lap to
    lap of a closed path, what the model does not explain is remembered by phase.

    Every command is the static model's setpoint for the pose nearest to where the path will be when
    the command has taken effect, in view of the offset that the estimator sees. Without
    measurements it goes on with what it knows.

    Raises:
        ConfigError: the description's rests were measured on another robot, or ``control.solver``
            needs an extra that is not installed.
    """

    name = "adaptive"

    def __init__(self, description: Description) -> None:
        self._limits = MotorLimits.of(description.servo)
        self._slew_rad_s = np.radians(description.servo.slew_deg_s)
        self._settle_s = description.control.settle_s
        self._scaling = Scaling.of(description)
        self._identified = identified_rests(description)
        self._model = make_model(description.control)

    def start(self, reference: Reference) -> Command:
        """Plan from the prior; the command of step 0 without an approach."""
        self._reference = reference
        self._samples = np.arange(len(reference), dtype=np.float64)
        self._ramp_s = min(_RAMP_SHARE * reference.period_s, _LONGEST_RAMP_S)
        self._estimator = Estimator(self._scaling, None, Tuning(), self._model)
        self._survey = RestSurvey(self._scaling, np.zeros(2), self._model.predicted_mm)
        self._phase: _Phase | None = None
        self._fit: StaticsFit | None = None
        self._approach_setpoints: deque[FloatArray] = deque()
        self._approach_length = 0
        self._follower: PoseFollower | None = None
        self._seen_us: int | None = None
        self._memory = LapMemory(reference.lap_steps, reference.period_s)
        self._plan = self._plan_path()
        self._shift_rad = np.zeros(2)
        self._side = np.zeros(2)
        self._last_rad = self._first_setpoint()
        self._history = SetpointHistory(self._last_rad)
        return self._command(0.0, Outcome.SOLVED, self._ramp_s)

    def approach(self, observation: Observation) -> Command | None:
        """Tour of rests unless identified, fit, first point; None once the path may begin."""
        now_s = _seconds(observation.time_us)
        if self._phase is None:
            self._begin_approach(observation)
        if self._phase is _Phase.SURVEY:
            self._measure_rest(observation)
            if not self._approach_setpoints:
                self._phase, self._fit = _Phase.FIT, self._survey.fit()
        elif self._phase is _Phase.FIT:
            if self._fit is None or not self._fit.improve():
                self._begin_way_to_first_point()
        else:
            # Moves of the approach are faster than the path: lag would pass for an offset.
            if self._is_resting(observation):
                self._learn(observation)
            if not self._approach_setpoints:
                return None
        if self._approach_setpoints:
            self._last_rad = self._approach_setpoints.popleft()
        self._history.command(now_s, self._last_rad, APPROACH_PERIOD_S)
        command = self._command(0.0, Outcome.SOLVED, APPROACH_PERIOD_S)
        return replace(command, phase=self._approach_phase())

    @property
    def is_identified(self) -> bool:
        """Whether the approach has no tour of its own."""
        return self._identified is not None

    @property
    def rests(self) -> Rests:
        """What the model was fitted to."""
        return self._survey.rests() if self._fit is None else self._fit.rests

    @property
    def fit(self) -> StaticsFit | None:
        """That the path was planned with; None where no such robot rests there."""
        return self._fit

    def step(self, observation: Observation) -> Command:
        """Measurement in, command out; works without measurements too."""
        self._phase = _Phase.PATH
        now_s = _seconds(observation.time_us)
        if np.abs(observation.q_rad - self._last_rad).max() > _OTHER_COMMAND_RAD:
            self._last_rad = observation.q_rad
            self._history.command(now_s, self._last_rad, self._ramp_s)
        seen = self._learn(observation)
        index = self._index_in_effect(observation.step)
        setpoint = self._setpoint_at(index)
        most = self._slew_rad_s * self._reference.period_s
        self._last_rad = self._last_rad + np.clip(setpoint - self._last_rad, -most, most)
        self._history.command(now_s, self._last_rad, self._ramp_s)
        outcome = Outcome.SOLVED if seen else Outcome.COASTED
        return self._command(index, outcome, self._ramp_s)

    def _begin_approach(self, observation: Observation) -> None:
        self._last_rad = observation.q_rad
        self._history = SetpointHistory(observation.q_rad)
        if self._identified is not None:
            self._fit = fit_to(self._scaling, self._identified, self._model.predicted_mm)
        if self._fit is None:
            self._begin_survey(observation)
        else:
            self._phase = _Phase.FIT

    def _begin_survey(self, observation: Observation) -> None:
        self._phase = _Phase.SURVEY
        self._survey = RestSurvey(self._scaling, observation.q_rad, self._model.predicted_mm)
        self._go_through(tour_stops_rad(self._estimator.parameters, self._limits), _TOUR_REST_S)

    def _begin_way_to_first_point(self) -> None:
        self._phase = _Phase.TO_FIRST_POINT
        fit = None if self._fit is None else self._fit.result()
        self._estimator = Estimator(self._scaling, fit, Tuning(), self._model)
        self._plan = self._plan_path()
        self._follower = None
        self._go_through(self._first_setpoint()[None], self._settle_s)

    def _go_through(self, stops_rad: FloatArray, rest_s: float) -> None:
        setpoints = tour(self._last_rad, stops_rad, rest_s, APPROACH_PERIOD_S)
        self._approach_setpoints = deque(setpoints)
        self._approach_length = len(setpoints)

    def _approach_phase(self) -> Phase | None:
        if self._phase is None:
            return None
        is_moving = self._phase is not _Phase.FIT
        left = len(self._approach_setpoints) / max(self._approach_length, 1)
        return Phase(self._phase.value, 1.0 - left if is_moving else None)

    def _measure_rest(self, observation: Observation) -> None:
        exposed_us = self._new_exposure_us(observation)
        if exposed_us is not None and observation.tip_mm is not None:
            time_s = _seconds(exposed_us) - self._estimator.delay_s
            markers_mm = np.stack([observation.middle_mm, observation.tip_mm])
            self._survey.add(self._history, time_s, markers_mm)

    def _is_resting(self, observation: Observation) -> bool:
        seen_s = _seconds(observation.time_us - observation.tip_age_us)
        return seen_s - self._history.resting_since(seen_s) > SETTLED_AFTER_S

    def _learn(self, observation: Observation) -> bool:
        """Correct the estimate; whether there was a measurement, new or not."""
        estimator = self._estimator
        before_us = self._seen_us
        exposed_us = self._new_exposure_us(observation)
        if exposed_us is None or observation.tip_mm is None:
            oldest_s = _seconds(observation.time_us) - _OLDEST_SAMPLE_S
            self._following(oldest_s).advance_to(estimator.parameters, oldest_s)
            return observation.tip_mm is not None
        if before_us is not None:
            estimator.elapse(_seconds(exposed_us - before_us))
        time_s = _seconds(exposed_us) - estimator.delay_s
        follower = self._following(time_s)
        rest = follower.advance_to(estimator.parameters, time_s)
        rate_rad_s, jolt_rad = self._history.rate_at(time_s), self._history.jolt_at(time_s)
        remembered_mm = self._remember(observation, rest, jolt_rad)
        seen_mm = observation.tip_mm - remembered_mm
        follower.rest = estimator.correct(rest, rate_rad_s, jolt_rad, seen_mm)
        return True

    def _remember(self, observation: Observation, rest: Rest, jolt_rad: float) -> FloatArray:
        """Note for the next lap what the model does not explain; what the last one has noted."""
        if self._phase is not _Phase.PATH or observation.tip_mm is None:
            return np.zeros(3)
        # The end of period i, when f_i is aimed at, is the beginning of step i + 1.
        age_s = _seconds(observation.tip_age_us)
        index = observation.step - 1.0 - age_s / self._reference.period_s
        estimator, memory = self._estimator, self._memory
        gained_mm = memory.turn(index)
        if gained_mm is not None:
            estimator.hand_over(gained_mm)
        unexplained_mm = observation.tip_mm - tip_mm(estimator.parameters, rest.theta_rad)
        memory.note(index, unexplained_mm, estimator.trust(jolt_rad))
        return memory.at(index)

    def _following(self, time_s: float) -> PoseFollower:
        if self._follower is None:
            p = self._estimator.parameters
            self._follower = PoseFollower(p, self._history, time_s, self._model)
        return self._follower

    def _new_exposure_us(self, observation: Observation) -> int | None:
        """When the measurement was made; None if there is none, or none that is new."""
        tip = observation.tip_mm
        exposed_us = observation.time_us - observation.tip_age_us
        if tip is None or not np.isfinite(tip).all() or exposed_us == self._seen_us:
            return None
        self._seen_us = exposed_us
        return exposed_us

    def _index_in_effect(self, step: int) -> float:
        """Fractional step at which this command will have taken effect."""
        periods = (self._estimator.delay_s + self._ramp_s) / self._reference.period_s
        return min(step + max(0.0, periods - 1.0), len(self._samples) - 1.0)

    def _setpoint_at(self, index: float) -> FloatArray:
        """Setpoint for the nearest pose to the path at a fractional step, next to the planned."""
        target_mm = [np.interp(index, self._samples, axis) for axis in self._reference.target_mm.T]
        p = self._estimator.believed
        expected_mm = self._estimator.offset_mm + self._memory.at(index)
        aim_mm = np.array(target_mm) - turned_back_mm(p, expected_mm)
        planned = self._plan.bending_rad(index)
        theta = self._model.polished(p, planned + self._shift_rad, aim_mm, _REFINEMENTS)
        self._shift_rad = np.clip(theta - planned, -_LONGEST_SHIFT_RAD, _LONGEST_SHIFT_RAD)
        self._theta_rad = planned + self._shift_rad
        drive = self._following(-np.inf).hold_ahead(self._estimator.parameters)
        hold = hold_at(p, self._theta_rad, drive.anchor, self._side)
        self._side = hold.side
        return self._limits.clip(setpoint_for(p, drive, hold.shaft_rad))

    def _first_setpoint(self) -> FloatArray:
        self._theta_rad = self._plan.bending_rad(0.0)
        p = self._estimator.parameters
        return self._limits.clip(unhindered_setpoints_for(p, self._theta_rad))

    def _plan_path(self) -> PathPlan:
        stride = max(1, round(_KNOT_PERIOD_S / self._reference.period_s))
        knots = np.unique(np.append(self._samples[::stride], self._samples[-1]))
        targets_mm = self._reference.target_mm[knots.astype(int)]
        p, near, polish = self._estimator.parameters, np.zeros(2), self._model.polished
        return plan_path(p, self._limits, targets_mm, knots, near, polish)

    def _command(self, index: float, outcome: Outcome, ramp_s: float) -> Command:
        predicted_mm = tip_mm(self._estimator.believed, self._theta_rad)
        expected = predicted_mm + self._estimator.offset_mm + self._memory.at(index)
        return Command(self._last_rad, expected[None], outcome, ramp_s=ramp_s)


def _seconds(time_us: int) -> float:
    return time_us / _US_PER_S
