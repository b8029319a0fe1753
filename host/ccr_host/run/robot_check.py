"""Checks that the robot is the described one, before its path and along it.

A few small moves, or the tour of `adaptive`, are fitted by the static model of `adaptive`, which
knows any robot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator
from functools import partial
from typing import Any

import numpy as np

from ccr_host.control.adaptive.identification import RestSurvey, StaticsFit
from ccr_host.control.adaptive.law import AdaptiveLaw
from ccr_host.control.adaptive.misfit import (
    REPEATED,
    RIVAL,
    MisfitError,
    is_doubtful,
    is_misfit,
    misfit,
    misfit_of,
    not_as_described,
    standing_still,
)
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.static_model import Resting, StaticModel
from ccr_host.control.base import Controller
from ccr_host.control.registry import rate_note
from ccr_host.control.shell import Law, Measurement, PathView, Shell, Stage, smooth_moves
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.changed_robot import likely_change
from ccr_host.run.motor_responses import Explanation, MotorResponses
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
_MOST_TURNED_RAD = np.radians(8.6)
"""The same as the turn of a motor, 1.9 mm of tendon with the paper's robot: what slack and friction
leave is a length of tendon, which bends a thin segment further. A tooth is 14 deg."""
_MOST_LEFT_SHARE = 4.0 / 102.0
"""What no bending explains, over the robot's length: a camera that was turned, a marker that slid.
Of robots that match the largest is 0.011 in the median and exceeds this in one of 200 with few
moves, in one of 10 000 with the tour of `adaptive`, alike."""
_UNTOLD = 3.5
"""Deviations by which what rests left open may move the pose beyond these limits: a normal one is
further off in one look of 2000. Of 11 random robots of the paper's kind that match (few moves,
`pid-ik`, 1 Hz) the farthest in 80 s is 2.4, with 0.05 rad for the model's own errors."""
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
        self._description = description
        self._limits = MotorLimits.of(description.servo)
        self._stops = probe_stops(description.robot)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._survey = RestSurvey(np.zeros_like(self._limits.lower_rad))
        self.fits: list[StaticsFit[Any]] = []
        """Fits that explain the rests so far, the likeliest first; before that none."""
        self.explanation: Explanation | None = None
        """Which motors or camera explain the rests better than the description, if others do."""
        self._is_undecided = False
        """Whether it is as likely as not that others do."""

    @property
    def rests(self) -> Rests:
        """The rests at which the robot was seen."""
        return self._survey.rests()

    def stages(self) -> Iterator[Stage]:
        """Moves, then a fit, during which the robot stays where it is; more moves if in doubt."""
        here_rad = self.history.at(math.inf)
        self._survey = RestSurvey(here_rad)
        for reach_rad in _REACHES_RAD:
            stops_rad = self._limits.clip(here_rad + reach_rad * self._stops)
            self._survey.visit(stops_rad)
            yield Stage(self.name, smooth_moves(self.history.at(math.inf), stops_rad, _REST_S))
            if not len(self.rests.count):
                return
            waiting = Stage(self.name, stops_rad[-1:], is_motion=False)
            for _ in self._judging(self.rests):
                yield waiting
            if not self._is_doubtful():
                return

    def _judging(self, rests: Rests) -> Iterator[None]:
        """Fit the rests, then as other motors or another camera would have made them, if likely."""
        self.fits = yield from self._fitting(rests)
        self.explanation, self._is_undecided = None, False
        was_led = len(rests.q_rad) > 1 and np.array_equal(rests.q_rad[0], rests.from_rad[0])
        if not (self._description.robot.segments and was_led):
            return
        likely = MotorResponses(self._description, rests).explanation()
        if likely is not None:
            described = self._space.parameters(np.zeros(self._space.count))
            supposed = likely.supposed(rests, partial(self._model.predicted_mm, described))
            others = yield from self._fitting(supposed)
            gain = self.fits[0].result().cost - others[0].result().cost
            self.explanation = likely if gain > likely.price else None
            self._is_undecided = abs(gain) <= likely.price

    def _fitting(self, rests: Rests) -> Generator[None, None, list[StaticsFit[Any]]]:
        """Fit rests, one step at a time; start again elsewhere if that may be better."""
        fits: list[StaticsFit[Any]] = []
        for start in self._space.few_starts():
            fit = StaticsFit(self._space, rests, self._model, start)
            yield
            while fit.improve():
                yield
            fits.append(fit)
            fits.sort(key=lambda one: one.result().cost)
            if not (self._space.has_modes or is_doubtful(fits[0].result(), self._space)):
                break
        best = fits[0].result().cost
        return [fit for fit in fits if fit.result().cost < best + RIVAL]

    def _is_doubtful(self) -> bool:
        """Whether farther moves, which take up more slack, should decide."""
        found = self.fits[0].result()
        if self.explanation is not None or is_misfit(found, self.fits[0].rests, self._space):
            return False
        return self._is_undecided or is_doubtful(found, self._space)

    def observe(self, measurement: Measurement) -> None:
        self._survey.add(self.history, measurement)


class _Belief:
    """A fit that explains the rests, and the pose of its robot along the path."""

    def __init__(self, statics: StaticModel[Any, Any], fit: StaticsFit[Any]) -> None:
        self._statics, self.fit = statics, fit
        self.p = fit.scaling.parameters(fit.result().score)
        self._pose: Resting | None = None

    def theta_rad(self, q_rad: Array) -> Array:
        """Bending angles, (D,), after the motors have moved on to these angles, (n,)."""
        if self._pose is None:
            self._pose = self._statics.first_pose(self.p, q_rad)
        self._pose = self._statics.moved(self.p, self._pose, math.inf, q_rad)
        return self._pose.theta_rad


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
        self._nominal = ConstantCurvature(robot)
        radius_mm = [
            robot.chain[number].tendon_radius_mm for number in self._nominal.segment_of_freedom
        ]
        turned_rad = _MOST_TURNED_RAD * robot.pulley_radius_mm / np.array(radius_mm)
        self._most_bent_rad = np.maximum(_MOST_BENT_RAD, turned_rad)
        self._noise_mm = _SIGMAS * description.tracker.noise_mm
        self._statics, _ = make_static_model(description)
        self._beliefs: list[_Belief] = []
        """What explains the rests, the likeliest first; none before the path or if too few rests
        were seen."""
        self.told = "the markers were seen at too few rests: the robot's motion is not checked"
        """The result of the rests before the path, for the log."""
        self._looked_us = 0
        self._odd_us = 0.0
        """Time for which the poses have been unexplained, less a share of that for which not."""
        self._seen: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)
        """Motor angles, (n,), and ends, (S, 3), of the last looks that were unexplained."""

    def judge_probe(self) -> Rests | None:
        """The rests of the probe if the description does not explain them, else None."""
        if self._probe is None:
            return None
        odd = self._judge(self._probe.rests, self._probe.fits)
        return odd if self._probe.explanation is None else self._probe.rests

    def judge_approach(self) -> Rests | None:
        """The rests of the controller's own fit, if any, that the description does not explain."""
        adaptive = self._adaptive
        if adaptive is None:
            return None
        return self._judge(adaptive.rests, [] if adaptive.fit is None else [adaptive.fit])

    def judge_step(self, time_us: int, q_rad: Array, ends_mm: Array) -> Rests | None:
        """The poses along the path, once they have been unexplained for some seconds, else None."""
        passed_us = time_us - self._looked_us
        if not self._beliefs or passed_us < _LOOK_PERIOD_US:
            return None
        passed_us = min(passed_us, _MOST_COUNTED_US)
        self._looked_us = time_us
        odd = [self._is_odd(belief, q_rad, ends_mm) for belief in self._beliefs]
        if not all(odd):
            self._odd_us -= _FORGIVEN * passed_us
            if self._odd_us <= 0.0:
                self._odd_us = 0.0
                self._seen.clear()
            return None
        self._odd_us += passed_us if self._seen else 0.0
        self._seen.append((q_rad, ends_mm))
        if self._odd_us < _FOR_US:
            return None
        setpoints_rad, seen_mm = (np.array(column) for column in zip(*self._seen, strict=True))
        return Rests.of_vectors(setpoints_rad, setpoints_rad, seen_mm, np.ones(len(seen_mm)))

    def _is_odd(self, belief: _Belief, q_rad: Array, seen_mm: Array) -> bool:
        """Whether markers, (S, 3), are not where a robot at these motor angles has them."""
        theta_rad = belief.theta_rad(q_rad)
        away_mm = seen_mm - self._statics.markers_mm(belief.p, theta_rad[None])[0]
        most_left_mm = _MOST_LEFT_SHARE * self._length_mm + self._noise_mm
        if np.nansum(away_mm**2) < most_left_mm**2:
            return False
        found = self._statics.seen_pose(belief.p, theta_rad, seen_mm)
        off_mm = np.zeros((2, seen_mm.size))
        off_mm[0, -3:], off_mm[1] = away_mm[-1], np.nan_to_num(found.left_mm).ravel()
        sizes_mm = np.linalg.norm(off_mm, axis=1)
        sizes = np.concatenate([sizes_mm, np.abs(found.theta_rad - theta_rad)])
        of_tip_mm = _UNEXPLAINED_SHARE * self._length_mm
        limits = np.concatenate([[of_tip_mm, most_left_mm], self._most_bent_rad])
        if (sizes < limits).all():
            return False
        directions = np.vstack([off_mm / np.maximum(sizes_mm, 1e-9)[:, None], found.by_markers])
        uncertain = directions @ belief.fit.uncertain_mm2(q_rad) * directions
        untold = _UNTOLD * np.sqrt(uncertain.sum(axis=1))
        return bool((sizes >= np.maximum(limits, untold)).any())

    def cause_of(self, odd: Rests) -> MisfitError:
        """Find what is most likely wrong; takes up to a minute, so make the robot safe first."""
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
        others = self._probe and self._probe.explanation
        if others and (named := others.cause_and_cure()):
            return not_as_described(*named)
        if self._beliefs:
            fit = self._beliefs[0].fit
            return misfit_of(fit.result(), fit.scaling)
        return not_as_described(*_UNKNOWN)

    def _change_of(self, odd: Rests) -> tuple[str, str] | None:
        """Cause and cure of poses along the path, of a robot that matched before it."""

        def predict(q_rad: Array) -> Array:
            led = Rests.in_turn(q_rad[0], q_rad, odd.markers_mm, odd.count)
            return self._statics.predicted_mm(self._beliefs[0].p, led)

        limits, model = MotorLimits.of(self._description.servo), self._nominal
        _, by_bending = model.markers_mm(model.bending_rad(odd.q_rad))
        return likely_change(predict, limits, odd.q_rad, odd.vectors_mm, by_bending)

    def _judge(self, rests: Rests, fits: list[StaticsFit[Any]]) -> Rests | None:
        if len(rests.count) < self._fewest_rests:
            return None
        self._beliefs = [_Belief(self._statics, fit) for fit in fits]
        if not fits:  # The rests were too odd to be fitted.
            return rests
        found = fits[0].result()
        self.told = f"the robot was seen at {len(rests.count)} rests; {found.residual}"
        return rests if is_misfit(found, rests, fits[0].scaling) else None


def motion_check(
    options: RunOptions, controller: Controller, description: Description, reference: Reference
) -> RobotCheck | None:
    """The check of the motion, None if the run does not ask for it."""
    if options.effective_checks != "motion":
        return None
    note = rate_note(options.controller, options.rate_hz, description.robot)
    return RobotCheck(description, controller, reference, note)
