"""Checks that the robot is the described one, before its path and along it.

Of two planar segments with a motor each, by the static model of `adaptive`; `response_check` is for
any other robot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from ccr_host.control.adaptive.arithmetic import FloatArray
from ccr_host.control.adaptive.identification import RestSurvey, StaticsFit
from ccr_host.control.adaptive.law import AdaptiveLaw
from ccr_host.control.adaptive.misfit import MisfitError, is_misfit, misfit
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.motion import Pose, first_pose, moved
from ccr_host.control.adaptive.parameters import ZEROS, Parameters, Scaling
from ccr_host.control.adaptive.tip import tip_mm
from ccr_host.control.base import Controller
from ccr_host.control.shell import Law, Measurement, PathView, Shell, Stage, smooth_moves
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.options import RunOptions
from ccr_host.run.response_check import ResponseCheck

_REACH_RAD = np.radians(20.0)
"""Travel of each motor: beyond slack and a wrong zero, and half of what paths need."""
_STOPS = ((0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))
"""Motor 1 last: falling through its slack sets the robot swinging."""
_REST_S = 0.8
_ZERO_FREEDOM = 3.0
"""Factor by which zeros may be further off than assumed, as there are few rests."""
_FEWEST_RESTS = 4
"""With fewer rests, because markers were hidden, nothing can be said."""
_LOOK_PERIOD_US = 250_000
_UNEXPLAINED_MM = 25.0
"""Distance of tip and model: twice what loads, friction and a fit to few rests leave."""
_FOR_US = 3_000_000
_KEPT = 12
"""Number of looks from which the cause is determined."""


class ProbeLaw(Law):
    """A few small moves that show whether the robot is the described one."""

    name = "checking that the robot moves as described"
    feedback_s = 0.0

    def __init__(self, description: Description) -> None:
        self._scaling = Scaling.of(description).strict().freed(ZEROS, _ZERO_FREEDOM)
        self._limits = MotorLimits.of(description.servo)
        self._predict = make_model(description.control).predicted_mm

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._survey = RestSurvey(np.zeros(2))
        self.fit: StaticsFit[Parameters] | None = None
        """Fit of the model to the rests; None before all are known."""

    @property
    def rests(self) -> Rests:
        """The rests at which the robot was seen."""
        return self._survey.rests()

    def stages(self) -> Iterator[Stage]:
        """The moves, then the fit, during which the robot stays where it is."""
        here_rad = self._survey.start_rad = self.history.at(math.inf)
        stops_rad = self._limits.clip(here_rad + _REACH_RAD * np.array(_STOPS))
        yield Stage(self.name, smooth_moves(here_rad, stops_rad, _REST_S))
        waiting = Stage(self.name, stops_rad[-1:], is_motion=False)
        self.fit = StaticsFit(self._scaling, self.rests, self._predict)
        yield waiting
        while self.fit.improve():
            yield waiting

    def observe(self, measurement: Measurement) -> None:
        self._survey.add(self.history, measurement)


class RobotCheck:
    """Judges the rests before the path, and the robot's response along it.

    Args:
        description: of the robot.
        controller: no probe is needed if it begins with a tour of rests.
        reference: the path.
    """

    def __init__(
        self, description: Description, controller: Controller, reference: Reference
    ) -> None:
        self._description = description
        law = controller.law if isinstance(controller, Shell) else None
        self._adaptive = law if isinstance(law, AdaptiveLaw) else None
        self._probe: ProbeLaw | None = None
        self.probe: Shell | None = None
        """Makes the probing moves in its approach; None if no probe is needed."""
        if self._adaptive is None or self._adaptive.is_identified:
            self._probe = ProbeLaw(description)
            self.probe = Shell(description, self._probe)
            self.probe.start(reference)
        self._model: Parameters | None = None
        self._told = "the markers were seen at too few rests: the robot's motion is not checked"
        self._pose: Pose | None = None
        self._looked_us = 0
        self._odd_since_us: int | None = None
        self._seen: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=_KEPT)

    @property
    def told(self) -> str:
        """The result of the rests before the path, for the log."""
        return self._told

    def judge_probe(self) -> Rests | None:
        """The rests of the probe if the description does not explain them, else None."""
        return None if self._probe is None else self._judge(self._probe.rests, self._probe.fit)

    def judge_approach(self) -> Rests | None:
        """The rests of the controller's own fit, if any, that the description does not explain."""
        adaptive = self._adaptive
        return None if adaptive is None else self._judge(adaptive.rests, adaptive.fit)

    def judge_step(
        self, time_us: int, q_rad: FloatArray, middle_mm: FloatArray, seen_mm: FloatArray
    ) -> Rests | None:
        """The poses along the path, once they have been unexplained for some seconds, else None."""
        if self._model is None or time_us - self._looked_us < _LOOK_PERIOD_US:
            return None
        p, self._looked_us = self._model, time_us
        q_1, q_2 = q_rad.tolist()
        pose = self._pose
        self._pose = first_pose(p, q_1, q_2) if pose is None else moved(p, pose, q_1, q_2)
        self._seen.append((q_rad, np.stack([middle_mm, seen_mm])))
        expected_mm = tip_mm(p, self._pose.theta_1, self._pose.theta_2)
        if np.linalg.norm(seen_mm - expected_mm) < _UNEXPLAINED_MM:
            self._odd_since_us = None
            return None
        if self._odd_since_us is None:
            self._odd_since_us = time_us
        if time_us - self._odd_since_us < _FOR_US:
            return None
        setpoints_rad, markers = (np.array(column) for column in zip(*self._seen, strict=True))
        count = np.ones(len(markers))
        return Rests.of_vectors(setpoints_rad[0], setpoints_rad, markers, count)

    def cause_of(self, odd: Rests) -> MisfitError:
        """Find what is most likely wrong; takes seconds, so make the robot safe first."""
        found = misfit(odd, self._description)
        return MisfitError(found.cause, f"{found.cure}; --unchecked goes on all the same")

    def _judge(self, rests: Rests, fit: StaticsFit[Parameters] | None) -> Rests | None:
        if len(rests.count) < _FEWEST_RESTS:
            return None
        if fit is None:  # The rests were too odd to be fitted.
            return rests
        found = fit.result()
        self._model, self._pose = fit.scaling.parameters(found.score), None
        self._told = f"the robot was seen at {len(rests.count)} rests; {found.residual}"
        return rests if is_misfit(found, rests, fit.scaling) else None


MotionCheck = RobotCheck | ResponseCheck


def motion_check(
    options: RunOptions, controller: Controller, description: Description, reference: Reference
) -> MotionCheck | None:
    """The check of the motion, None if the run does not ask for it."""
    if options.effective_checks != "motion":
        return None
    if description.robot.segments:
        return ResponseCheck(description, reference)
    return RobotCheck(description, controller, reference)
