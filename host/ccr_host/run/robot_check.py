"""Checks that the robot is the described one, before its path and along it.

A few small moves, or the tour of `adaptive`, are fitted by the static model of `adaptive`, which
knows any robot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ccr_host.control.adaptive.identification import RestSurvey, StaticsFit
from ccr_host.control.adaptive.law import AdaptiveLaw
from ccr_host.control.adaptive.misfit import (
    REPEATED,
    MisfitError,
    is_doubtful,
    is_misfit,
    misfit,
    misfit_of,
    not_as_described,
    standing_still,
)
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.static_model import Resting
from ccr_host.control.base import Controller
from ccr_host.control.registry import rate_note
from ccr_host.control.shell import Law, Measurement, PathView, Shell, Stage, smooth_moves
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.changed_robot import likely_change
from ccr_host.run.motor_responses import MotorResponses
from ccr_host.run.options import RunOptions

_REACHES_RAD = np.radians((20.0, 35.0, 50.0))
"""Travel of each motor: beyond slack and a wrong zero, and half of what paths need; then, of a
robot that may be the described one or not, more, at which slack differs from scale."""
_REST_S = 0.8
_LOOK_PERIOD_US = 250_000
_UNEXPLAINED_SHARE = 25.0 / 102.0
"""Distance of tip and model over the robot's length: twice what loads, friction and a fit to few
rests leave."""
_MOST_BENT_RAD = 0.42
"""Angle by which a segment may be bent otherwise than the model has it. Loads bend the first one,
by less before they take the tip too far away; a servo that slips by a tooth bends its own by more.
Of robots that match the largest, kept for `_FOR_US`, is 0.08 rad in the median and exceeds this
limit in one of 2000 if its logarithm is normal."""
_MOST_LEFT_SHARE = 4.0 / 102.0
"""What no bending explains, over the robot's length: a camera that was turned, a marker that slid.
Of robots that match the largest is 0.011 in the median and exceeds this in one of 200 with few
moves, in one of 10 000 with the tour of `adaptive`, alike."""
_SIGMAS = 2.0
"""Of a distance of markers by the described noise, for each of several looks in a row."""
_FOR_US, _FORGIVEN = 3_000_000, 0.5
"""Time for which poses may be unexplained, and how fast explained ones make up for it."""
_MOST_COUNTED_US = 1_000_000
"""Time that a look counts for, at most: what happened while the markers were hidden is unknown."""
_STIRS_RAD = math.radians(2.0)
"""Travel of a motor beyond backlash and deadband: along the path few degrees pass in `_FOR_US`."""
_KEPT = 12
"""Number of looks from which the cause is determined."""
_ALONG_PATH = (
    f"for {_FOR_US // 1_000_000} s its markers were not where the model has them",
    "check that nothing holds it, and [[robot.segments]] with its tendons; a controller that winds "
    "tendons against each other leads there, too",
)
_UNKNOWN = (
    "no usual cause explains it",
    "check that nothing holds it, [[robot.segments]] with its tendons, and which marker is which "
    "with ccr-host monitor",
)


def probe_stops(robot: Robot) -> Array:
    """Moves in units of the reach, (N, n): rest, then each motor to where it pulls a tendon.

    The first motor is last, as falling through its slack sets the robot swinging.
    """
    stops = [np.zeros(robot.motors)]
    for motor in reversed(range(robot.motors)):
        windings = {t.winding for _, t in robot.tendons if t.motor == motor + 1}
        stops.extend(side * np.eye(robot.motors)[motor] for side in sorted(windings, reverse=True))
    return np.array(stops)


class ProbeLaw(Law):
    """A few small moves that show whether the robot is the described one."""

    name = "checking that the robot moves as described"
    feedback_s = 0.0

    def __init__(self, description: Description) -> None:
        self._model, space = make_static_model(description)
        self._space = space.of_few_rests()
        self._limits = MotorLimits.of(description.servo)
        self._stops = probe_stops(description.robot)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._survey = RestSurvey(np.zeros_like(self._limits.lower_rad))
        self.fit: StaticsFit[Any] | None = None
        """The likeliest fit of the model to the rests so far; None before all are known."""

    @property
    def rests(self) -> Rests:
        """The rests at which the robot was seen."""
        return self._survey.rests()

    def stages(self) -> Iterator[Stage]:
        """Moves, then a fit, during which the robot stays where it is; more moves if in doubt."""
        here_rad = self._survey.start_rad = self.history.at(math.inf)
        for reach_rad in _REACHES_RAD:
            stops_rad = self._limits.clip(here_rad + reach_rad * self._stops)
            yield Stage(self.name, smooth_moves(self.history.at(math.inf), stops_rad, _REST_S))
            if not len(self.rests.count):
                return
            waiting = Stage(self.name, stops_rad[-1:], is_motion=False)
            for _ in self._fitting():
                yield waiting
            if not self._is_doubtful():
                return

    def _fitting(self) -> Iterator[None]:
        """Fit the rests, one step at a time; start again elsewhere if that may be better."""
        rests, self.fit = self.rests, None
        for start in self._space.few_starts():
            fit = StaticsFit(self._space, rests, self._model.predicted_mm, start)
            yield
            while fit.improve():
                yield
            if self.fit is None or fit.result().cost < self.fit.result().cost:
                self.fit = fit
            if not is_doubtful(self.fit.result(), self._space):
                return

    def _is_doubtful(self) -> bool:
        assert self.fit is not None
        found = self.fit.result()
        is_certain = is_misfit(found, self.rests, self._space)
        return is_doubtful(found, self._space) and not is_certain

    def observe(self, measurement: Measurement) -> None:
        self._survey.add(self.history, measurement)


class RobotCheck:
    """Judges the rests before the path, and the robot's response along it.

    The paper's robot needs no probe if the controller begins with a tour of rests. ``rate_note`` is
    what else may lead the robot off its model, see ``registry.rate_note``; or "".
    """

    def __init__(
        self,
        description: Description,
        controller: Controller,
        reference: Reference,
        rate_note: str,
    ) -> None:
        self._description = description
        self._rate_note = rate_note
        robot = description.robot
        law = controller.law if isinstance(controller, Shell) else None
        self._adaptive = law if isinstance(law, AdaptiveLaw) else None
        self._probe: ProbeLaw | None = None
        self.probe: Shell | None = None
        """Makes the probing moves in its approach; None if no probe is needed."""
        if self._adaptive is None or self._adaptive.is_identified or robot.segments:
            self._probe = ProbeLaw(description)
            self.probe = Shell(description, self._probe)
            self.probe.start(reference)
        self._fewest_rests = len(probe_stops(robot)) - 1
        self._length_mm = sum(segment.length_mm for segment in robot.chain)
        self._noise_mm = _SIGMAS * description.tracker.noise_mm
        self._statics, _ = make_static_model(description)
        self._model: Any = None
        """The parameters found, None before the path or if too few rests were seen."""
        self._fit: StaticsFit[Any] | None = None
        """The fit that the description does not explain."""
        self._responses: MotorResponses | None = None
        self.told = "the markers were seen at too few rests: the robot's motion is not checked"
        """The result of the rests before the path, for the log."""
        self._pose: Resting | None = None
        self._looked_us = 0
        self._odd_us = 0.0
        """Time for which the poses have been unexplained, less a share of that for which not."""
        self._seen: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)
        """Motor angles, (n,), M2 and the tip, (2, 3), of the last looks that were unexplained."""

    def judge_probe(self) -> Rests | None:
        """The rests of the probe if the description does not explain them, else None."""
        if self._probe is None:
            return None
        rests = self._probe.rests
        was_seen = len(rests.q_rad) > 1 and np.array_equal(rests.q_rad[0], rests.start_rad)
        odd = self._judge(rests, self._probe.fit)
        if self._description.robot.segments and was_seen:
            self._responses = MotorResponses(self._description, rests)
            odd = rests if self._responses.is_odd() else odd
        return odd

    def judge_approach(self) -> Rests | None:
        """The rests of the controller's own fit, if any, that the description does not explain."""
        adaptive = self._adaptive
        return None if adaptive is None else self._judge(adaptive.rests, adaptive.fit)

    def judge_step(
        self, time_us: int, q_rad: Array, middle_mm: Array, seen_mm: Array
    ) -> Rests | None:
        """The poses along the path, once they have been unexplained for some seconds, else None."""
        passed_us = time_us - self._looked_us
        if self._model is None or passed_us < _LOOK_PERIOD_US:
            return None
        passed_us = min(passed_us, _MOST_COUNTED_US)
        p, self._looked_us = self._model, time_us
        statics, pose = self._statics, self._pose
        pose = statics.first_pose(p, q_rad) if pose is None else statics.moved(p, pose, q_rad)
        self._pose = pose
        markers_mm = np.stack([middle_mm, seen_mm])
        if not self._is_odd(pose.theta_rad, markers_mm):
            self._odd_us -= _FORGIVEN * passed_us
            if self._odd_us <= 0.0:
                self._odd_us = 0.0
                self._seen.clear()
            return None
        self._odd_us += passed_us if self._seen else 0.0
        self._seen.append((q_rad, markers_mm))
        if self._odd_us < _FOR_US:
            return None
        setpoints_rad, markers = (np.array(column) for column in zip(*self._seen, strict=True))
        count = np.ones(len(markers))
        return Rests.of_vectors(setpoints_rad[0], setpoints_rad, markers, count)

    def _is_odd(self, theta_rad: Array, seen_mm: Array) -> bool:
        """Whether markers, (2, 3), are not where a robot bent by about ``theta_rad`` has them."""
        away_mm = seen_mm - self._statics.markers_mm(self._model, theta_rad[None])[0]
        most_left_mm = _MOST_LEFT_SHARE * self._length_mm + self._noise_mm
        if np.nansum(away_mm**2) < most_left_mm**2:
            return False
        if np.linalg.norm(away_mm[-1]) >= _UNEXPLAINED_SHARE * self._length_mm:
            return True
        found_rad, left_mm = self._statics.seen_pose(self._model, theta_rad, seen_mm)
        is_bent = np.abs(found_rad - theta_rad).max() >= _MOST_BENT_RAD
        return bool(is_bent or np.nansum(left_mm**2) >= most_left_mm**2)

    def cause_of(self, odd: Rests) -> MisfitError:
        """Find what is most likely wrong; takes seconds, so make the robot safe first."""
        found = self._cause_of(odd)
        cure = found.cure
        if self._seen and self._rate_note:
            cure += f"; or it is the controller: {self._rate_note}"
        return MisfitError(found.cause, f"{cure}; --unchecked goes on all the same")

    def _cause_of(self, odd: Rests) -> MisfitError:
        if self._seen:
            repeats = odd.are_one_picture(_STIRS_RAD)
            return not_as_described(*(REPEATED if repeats else self._change_of(odd) or _ALONG_PATH))
        if (still := standing_still(odd)) is not None:
            return still
        if not self._description.robot.segments:
            return misfit(odd, self._description)
        if self._responses and (named := self._responses.cause_and_cure()):
            return not_as_described(*named)
        if self._fit is not None:
            return misfit_of(self._fit.result(), self._fit.scaling)
        return not_as_described(*_UNKNOWN)

    def _change_of(self, odd: Rests) -> tuple[str, str] | None:
        """Cause and cure of poses along the path, of a robot that matched before it."""

        def predict(q_rad: Array) -> Array:
            led = replace(odd, start_rad=q_rad[0], q_rad=q_rad)
            return self._statics.predicted_mm(self._model, led)

        limits = MotorLimits.of(self._description.servo)
        return likely_change(predict, limits, odd.q_rad, odd.vectors_mm)

    def _judge(self, rests: Rests, fit: StaticsFit[Any] | None) -> Rests | None:
        if len(rests.count) < self._fewest_rests:
            return None
        if fit is None:  # The rests were too odd to be fitted.
            return rests
        found = fit.result()
        self._model, self._pose = fit.scaling.parameters(found.score), None
        self.told = f"the robot was seen at {len(rests.count)} rests; {found.residual}"
        if not is_misfit(found, rests, fit.scaling):
            return None
        self._fit = fit
        return rests


def motion_check(
    options: RunOptions, controller: Controller, description: Description, reference: Reference
) -> RobotCheck | None:
    """The check of the motion, None if the run does not ask for it."""
    if options.effective_checks != "motion":
        return None
    note = rate_note(options.controller, options.rate_hz)
    return RobotCheck(description, controller, reference, note)
