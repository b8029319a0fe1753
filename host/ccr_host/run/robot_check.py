"""Checks that the robot is the described one, before its path and along it.

A few small moves, or the tour of `adaptive`, are fitted by the static model of `adaptive`, which
knows any robot.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from ccr_host.control.adaptive.identification import StaticsFit
from ccr_host.control.adaptive.law import AdaptiveLaw
from ccr_host.control.adaptive.misfit import (
    REPEATED,
    MisfitError,
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
from ccr_host.control.shell import Shell
from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.changed_robot import likely_change
from ccr_host.run.motor_responses import ProbeLaw, probe_stops
from ccr_host.run.options import RunOptions

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
"""Deviations, by the described noise, that a distance of markers may be off in each of several
looks in a row."""
_FOR_US, _FORGIVEN = 3_000_000, 0.5
"""Time for which poses may be unexplained, and how fast explained ones make up for it."""
_MOST_COUNTED_US = 1_000_000
"""Time that a look counts for, at most: what happened while the markers were hidden is unknown."""
_STIRS_RAD = math.radians(2.0)
"""Travel of a motor beyond backlash and deadband: along the path few degrees pass in `_FOR_US`."""
_LED_AWAY_SHARE = 0.2
"""Distance over the robot's length by which a controller may leave the tip further from the path
than the open loop would."""
_NOTED_LENGTH = 2.5, 0.025
"""Error of a segment's length, or of their sum, that is remarked upon, mm and over the robot's
length: what lies on the surface of the described robot is then as far out of reach. Few moves tell
each length to 0.8 mm, the tour of `adaptive` to 0.4 (standard deviations)."""
_KEPT = 12
"""Number of looks from which the cause is determined."""
_ALONG_PATH = (
    f"for {_FOR_US // 1_000_000} s its markers were not where the model has them",
    "check that nothing holds it, and [[robot.segments]] with its tendons; a controller that winds "
    "tendons against each other leads there, too",
)
_OTHER_CONTROLLER = "take another controller or rate, see ccr-host track --help"
_UNCHECKED = "; --unchecked goes on all the same"
_UNKNOWN = (
    "no usual cause explains it",
    "check that nothing holds it, [[robot.segments]] with its tendons, and which marker is which "
    "with ccr-host monitor",
)


class _Belief:
    """A fit that explains the rests, and the pose of its robot as motors lead it."""

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

    def tip_mm(self, q_rad: Array) -> Array:
        """Tip, (3,), after that."""
        return self._statics.tip_mm(self.p, self.theta_rad(q_rad))


@dataclass
class _Spell:
    """Time for which something has been the case, less a share of that for which not."""

    is_on: bool = False
    lasted_us: float = 0.0

    def has_lasted(self, passed_us: int, *, is_so: bool) -> bool:
        """Count the time since the last look; tell whether `_FOR_US` is reached."""
        if is_so:
            self.lasted_us += passed_us if self.is_on else 0.0
            self.is_on = True
        else:
            self.lasted_us = max(0.0, self.lasted_us - _FORGIVEN * passed_us)
            self.is_on = self.lasted_us > 0.0
        return self.lasted_us >= _FOR_US


class LedAwayError(CcrError):
    """The controller leads the robot away from its path (exit status 3)."""


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
        self._reference = reference
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
        self.remark = ""
        """What is odd about a robot that is the described one all the same; empty if nothing is."""
        self._looked_us = 0
        self._unexplained, self._led_away = _Spell(), _Spell()
        self._open_loop: _Belief | None = None
        """The likeliest robot without feedback; None until it is asked for."""
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

    def judge_step(
        self, step: int, time_us: int, q_rad: Array, ends_mm: Array
    ) -> Rests | LedAwayError | None:
        """What has been wrong at the ends of steps for some seconds, None if nothing has.

        Poses that the model does not explain; or that it does, but that are further from the path
        than without feedback.
        """
        passed_us = time_us - self._looked_us
        if not self._beliefs or passed_us < _LOOK_PERIOD_US:
            return None
        passed_us = min(passed_us, _MOST_COUNTED_US)
        self._looked_us = time_us
        is_odd = all(self._is_odd(belief, q_rad, ends_mm) for belief in self._beliefs)
        is_unexplained = self._unexplained.has_lasted(passed_us, is_so=is_odd)
        if is_odd:
            self._seen.append((q_rad, ends_mm))
        elif not self._unexplained.is_on:
            self._seen.clear()
        if is_unexplained:
            setpoints_rad, seen_mm = (np.array(column) for column in zip(*self._seen, strict=True))
            count = np.ones(len(seen_mm))
            return Rests.of_vectors(setpoints_rad, setpoints_rad, seen_mm, count)
        off_mm, open_mm = self._distances_mm(step, ends_mm[-1])
        is_away = not is_odd and off_mm > open_mm + _LED_AWAY_SHARE * self._length_mm
        if not self._led_away.has_lasted(passed_us, is_so=is_away):
            return None
        return LedAwayError(
            f"the controller leads the robot, which moves as described, away from its path: the "
            f"tip is {off_mm:.0f} mm off, {open_mm:.0f} mm without feedback",
            f"{self._rate_note or _OTHER_CONTROLLER}{_UNCHECKED}",
        )

    def _distances_mm(self, step: int, tip_mm: Array) -> tuple[float, float]:
        """Distances of a tip from the path, and of that to which the open loop leads by the model.

        The latter is 0 where it does not matter.
        """
        target_mm = self._reference.target_mm[step]
        off_mm = float(np.linalg.norm(tip_mm - target_mm))
        if not off_mm > _LED_AWAY_SHARE * self._length_mm:
            return off_mm, 0.0
        self._open_loop = self._open_loop or _Belief(self._statics, self._beliefs[0].fit)
        open_mm = self._open_loop.tip_mm(self._reference.q_rad[step]) - target_mm
        return off_mm, float(np.linalg.norm(open_mm))

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
        return MisfitError(found.cause, f"{cure}{_UNCHECKED}")

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
        if is_misfit(found, rests, fits[0].scaling):
            return rests
        self.remark = self._remark_on(fits[0].scaling.mounting(found.score).lengths_mm)
        return None

    def _remark_on(self, found_mm: Array) -> str:
        """What to say about lengths of the segments, (S,)."""
        robot = self._description.robot
        described_mm = np.array([segment.length_mm for segment in robot.chain])
        off_mm = found_mm - described_mm
        least_mm, share = _NOTED_LENGTH
        if np.abs([*off_mm, off_mm.sum()]).max() < max(least_mm, share * self._length_mm):
            return ""
        found, described = (
            " and ".join(f"{mm:.3g}" for mm in one) for one in (found_mm, described_mm)
        )
        key = "length_mm in [[robot.segments]]" if robot.segments else "robot.segment_lengths_mm"
        return (
            f"segment lengths of {found} mm were found where {described} are described: the tip "
            f"cannot reach a path on the described robot's surface; measure {key}"
        )


def motion_check(
    options: RunOptions, controller: Controller, description: Description, reference: Reference
) -> RobotCheck | None:
    """The check of the motion, None if the run does not ask for it."""
    if options.effective_checks != "motion":
        return None
    note = rate_note(options.controller, options.rate_hz, description)
    return RobotCheck(description, controller, reference, note)
