"""The control loop: one path, one controller, one robot.

Timing, the same for every controller: the command of step i is given at the start of period i and
aims at f_i; the error of step i is taken at the end of that period, before the next command.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ccr_host.control.base import (
    APPROACH_PERIOD_S,
    Approaching,
    Command,
    Controller,
    Observation,
    Outcome,
    Phase,
    Picture,
    checked,
)
from ccr_host.core.arrays import Array
from ccr_host.core.clock import wall_ns
from ccr_host.core.errors import CcrError, CodeError, code_error
from ccr_host.description.schema import Description
from ccr_host.link.device_errors import LinkLossError
from ccr_host.robot.reference import Reference
from ccr_host.run.marker_watch import MarkerWatch
from ccr_host.run.observer import RunObserver, StepRecord
from ccr_host.run.rig import NoOperator, Operator, Rig
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

if TYPE_CHECKING:
    from ccr_host.robot.rests import Rests
    from ccr_host.run.robot_check import RobotCheck

_SOLVE_SHARE_OF_PERIOD = 0.5
"""A command later than this share of its period is dropped; the last one remains in effect."""
_VALIDITY_LIMITS_MS = (200, 10_000)
"""The lower limit tolerates a busy host, the upper one is that of the protocol."""

_BEAT_US = 100_000
"""A multiple of the board's tick and of the usual camera's period."""
_DISARMED = "; the robot is disarmed"
_CURE = "correct the controller"
_APPROACH = Phase("approaching the first point")
_PROBE = Phase("checking that the robot moves as described")

A = TypeVar("A")
Progress = Callable[[int, int, StepRecord], None]


@dataclass(eq=False)
class PathRun:
    """Arms the robot, approaches the first point, follows the path, disarms.

    While the operator wants a pause, the path's clock waits and the pose is held. If its
    motion is checked, the robot makes a few small moves first, and must then respond as described.
    """

    rig: Rig
    controller: Controller
    reference: Reference
    description: Description
    observer: RunObserver
    on_step: Progress
    operator: Operator = field(default_factory=NoOperator)
    _: KW_ONLY
    markers: MarkerCheck | None
    motion: RobotCheck | None = None

    def __post_init__(self) -> None:
        self._steps = len(self.reference)
        period_s, description = self.reference.period_s, self.description
        self._settle_s = description.control.settle_s
        self._period_us = round(period_s * 1e6)
        validity_ms = description.link.target_validity_periods * period_s * 1e3
        self._validity_ms = int(np.clip(validity_ms, *_VALIDITY_LIMITS_MS))
        self._feed_us = self._validity_ms * 1000 // 2
        self._records: list[StepRecord] = []
        self._start_us = self._sent_us = 0
        self._watch = MarkerWatch(self.rig, description, self._period_us, self.markers)

    def execute(self) -> list[StepRecord]:
        """Run, and return one record for each step of the reference.

        Raises:
            DeviceError: the board refused, was lost or latched a fault.
            TrackerError: the markers were lost for longer than coasting and holding allow.
            MisfitError: the robot is not the described one; it has been disarmed.
            LedAwayError: the controller leads the robot away from the path; likewise.
        """
        rig, clock = self.rig, self.rig.clock
        self._begin("planning")
        start = self.controller.start
        # A copy, as a controller may change it, and errors are measured against the path's own.
        reference = deepcopy(self.reference)
        command = self._usable(start, self._answer_of(start, reference, None)[0])
        self._begin("looking for the markers")
        self._watch.wait_for_markers()
        self._begin("arming")
        rig.client.arm()
        self._wait_for_whole_beat()
        if self.motion is not None and self.motion.probe is not None:
            self.observer.phase(clock.now_us(), _PROBE)
            here = Command(rig.client.accepted_rad, np.zeros((0, 3)), Outcome.SOLVED)
            self._approach(self.motion.probe, here, _PROBE)
            self._end_if_odd(self.motion.judge_probe())
        self._begin(_APPROACH.name)
        self.observer.control(clock.now_us(), None, command)
        leads = self.controller if isinstance(self.controller, Approaching) else None
        if leads is None:
            self._send_until(clock.now_us() + round(self._settle_s * 1e6), command)
        else:
            command = self._approach(leads, command, _APPROACH)
        if self.motion is not None:
            self._end_if_odd(self.motion.judge_approach())
            for text in filter(None, (self.motion.told, self.motion.remark)):
                self.observer.event(clock.now_us(), text)
        self._wait_for_whole_beat()
        self._start_us = clock.now_us()
        rig.start_path_clock(self._start_us)
        self._watch.start()
        self._begin("following the path")
        try:
            self._follow(command, leads is not None)
        except LinkLossError:
            self._skip_missed_steps(command)
            raise
        self._begin("disarming")
        rig.client.disarm()
        return self._records

    def _follow(self, command: Command, starts_with_step: bool) -> None:
        now_us, solve_us, late = self._start_us, 0.0, False
        while (step := len(self._records)) < self._steps:
            due_us = self._start_us + step * self._period_us
            if now_us - due_us >= self._period_us:
                self._skip_missed_steps(command)
                continue
            if self.operator.wants_pause:
                self._start_us += self._pause(command)
                self.rig.start_path_clock(self._start_us)
                now_us = self.rig.clock.now_us()
                continue
            if step > 0 or starts_with_step:
                command, solve_us, late = self._next_command(step, now_us, due_us, command)
            end_us = due_us + self._period_us
            now_us = self._send_until(end_us, command)
            self._judge(step, now_us, end_us, command, solve_us, late)

    def _end_if_odd(self, odd: Rests | CcrError | None) -> None:
        """Disarm before the cause is computed, and raise it."""
        if odd is not None and self.motion is not None:
            self._begin("disarming")
            self.rig.client.disarm()
            raise odd if isinstance(odd, CcrError) else self.motion.cause_of(odd)

    def _skip_missed_steps(self, held: Command) -> None:
        """Skip the steps whose time has passed.

        Their commands would be stale, and the robot was not observed at their ends.
        """
        now_us, first = self.rig.clock.now_us(), len(self._records)
        late_us = now_us - self._start_us - first * self._period_us
        missed = min(late_us // self._period_us, self._steps - first)
        if missed <= 0:
            return
        text = f"the host was late by {late_us * 1e-6:.2f} s: steps skipped: {missed}"
        self.observer.event(now_us, text)
        skipped = replace(held, outcome=Outcome.SKIPPED, detail="the host was late")
        for step in range(first, first + missed):
            end_us = self._start_us + (step + 1) * self._period_us
            self._keep(step, end_us, skipped, 0.0, True, None, None)

    def _wait_for_whole_beat(self) -> None:
        """Wait for a common beat: boards take different times to start, but runs are compared."""
        clock = self.rig.clock
        clock.sleep_until_us(-(-clock.now_us() // _BEAT_US) * _BEAT_US)

    def _answer_of(
        self, method: Callable[[A], object], argument: A, held: Command | None
    ) -> tuple[object, float]:
        """The controller's answer; the host resends the last command for as long as it takes.

        ``held`` is the command to resend; None before the robot is armed.

        Returns:
            The answer and the computing time in us.

        Raises:
            CodeError: the controller fails.
        """

        def ask() -> tuple[object, float]:
            start_ns = wall_ns()
            try:  # As `blaming` does, without its three calls a step.
                return method(argument), (wall_ns() - start_ns) / 1000
            except (CcrError, KeyboardInterrupt):
                raise
            except BaseException as error:
                raise code_error(_name_of(method), _CURE, error, _DISARMED) from error

        def feed() -> None:
            if held is not None:
                self._send(held, self.rig.clock.now_us())

        return self.rig.clock.beside(ask, self._feed_us, feed)

    def _send_until(self, end_us: int, command: Command) -> int:
        """Send a command, and resend it when the board's watchdog would not wait until the end.

        Returns:
            The time at the end, in us.
        """
        clock = self.rig.clock
        now_us = self._sent_us = clock.now_us()
        self._send(command, now_us)
        self._watch.setpoints.append((now_us, command.q_rad))
        while True:
            clock.sleep_until_us(min(end_us, now_us + self._feed_us))
            now_us = clock.now_us()
            if now_us >= end_us:
                return now_us
            self._send(command, now_us)

    def _approach(self, controller: Approaching, command: Command, phase: Phase) -> Command:
        """Let the controller lead the robot to the first point; return its last command."""
        clock = self.rig.clock
        self._watch.start()
        while True:
            due_us = clock.now_us()
            sample, must_hold = self._watch.look(due_us)
            if not must_hold:
                observation = self._observation(0, due_us, sample)
                led, _ = self._answer_of(controller.approach, observation, command)
                if led is None:
                    return command
                command = self._usable(controller.approach, led)
                self.observer.phase(due_us, command.phase or phase)
                self.observer.control(due_us, observation, command)
            self._sent_us = clock.now_us()
            self._send(command, self._sent_us)
            clock.sleep_until_us(due_us + round(APPROACH_PERIOD_S * 1e6))

    def _pause(self, command: Command) -> int:
        """Hold the pose until the operator continues; return the delay of the path in us."""
        clock = self.rig.clock
        since_us = resend_us = clock.now_us()
        self._begin("paused")
        while self.operator.wants_pause and not self.operator.wants_stop:
            if clock.now_us() >= resend_us:
                self._send(command, clock.now_us())
                resend_us = clock.now_us() + self._feed_us
            self._watch.fresh_sample(clock.now_us())
            clock.idle()
        beats = -(-(clock.now_us() - since_us) // _BEAT_US)
        clock.sleep_until_us(since_us + beats * _BEAT_US)
        self._watch.start()
        self._begin("following the path")
        return (clock.now_us() - since_us) // _BEAT_US * _BEAT_US

    def _next_command(
        self, step: int, now_us: int, due_us: int, last: Command
    ) -> tuple[Command, float, bool]:
        """The command of a step, its computing time in us, and whether it was too late."""
        sample, must_hold = self._watch.look(now_us)
        if must_hold:
            return _repeat(last, "markers lost"), 0.0, False
        observation = self._observation(step, now_us, sample)

        solve = self.controller.step
        answer, solve_us = self._answer_of(solve, observation, last)
        command = self._usable(solve, answer)
        self.observer.control(now_us, observation, command)
        if self.rig.clock.now_us() - due_us > _SOLVE_SHARE_OF_PERIOD * self._period_us:
            return _repeat(last, "command late"), solve_us, True
        return command, solve_us, False

    def _observation(self, step: int, time_us: int, sample: Sample | None) -> Observation:
        q_rad = self.rig.client.accepted_rad
        untaken = self._watch.untaken
        earlier: tuple[Picture, ...] = ()
        if untaken and untaken[-1] is sample:
            untaken.pop()
        if untaken:
            earlier = tuple(
                Picture(one.tip_mm, time_us - one.exposed_us, one.ends_mm) for one in untaken
            )
            untaken.clear()
        if sample is None:
            return Observation(step, time_us, None, 0, q_rad, earlier=earlier)
        age_us = time_us - sample.exposed_us
        return Observation(step, time_us, sample.tip_mm, age_us, q_rad, sample.ends_mm, earlier)

    def _send(self, command: Command, now_us: int) -> None:
        """Send a command, with what remains of its ramp since it was first sent."""
        left_s = max(0.0, command.ramp_s - (now_us - self._sent_us) * 1e-6)
        self.rig.client.set_target(
            command.q_rad, ramp_ms=round(left_s * 1e3), validity_ms=self._validity_ms
        )

    def _judge(
        self, step: int, now_us: int, end_us: int, command: Command, solve_us: float, late: bool
    ) -> None:
        """Record a step at the end of its period; a host late by another period has not seen it."""
        sample = self._watch.fresh_sample(now_us)
        if now_us < end_us + self._period_us:
            true_mm = self.rig.true_tip_mm()
            self._keep(step, now_us, command, solve_us, late, sample, true_mm)
        else:
            self._keep(step, end_us, command, solve_us, late, None, None)
        if self.motion is not None and sample is not None:
            q_rad = self.rig.client.accepted_rad
            odd = self.motion.judge_step(step, now_us, q_rad, sample.ends_mm)
            self._end_if_odd(odd)

    def _keep(
        self,
        step: int,
        end_us: int,
        command: Command,
        solve_us: float,
        late: bool,
        sample: Sample | None,
        true_mm: Array | None,
    ) -> None:
        record = StepRecord(
            step=step,
            end_us=end_us,
            time_s=float(self.reference.time_s[step]),
            target_mm=self.reference.target_mm[step],
            q_rad=command.q_rad,
            outcome=command.outcome,
            detail=command.detail,
            predicted_mm=command.predicted_mm,
            solve_us=solve_us,
            late=late,
            measured_mm=None if sample is None else sample.tip_mm,
            measured_age_us=None if sample is None else end_us - sample.exposed_us,
            true_mm=true_mm,
        )
        self.observer.step(record)
        self.on_step(step, self._steps, record)
        self._records.append(record)

    def _usable(self, method: Callable[[A], object], answer: object) -> Command:
        try:
            return checked(answer, self.reference.q_rad.shape[1])
        except ValueError as error:
            cause = f"{_name_of(method)} has answered {error}{_DISARMED}"
            raise CodeError(cause, _CURE) from None

    def _begin(self, phase: str) -> None:
        self.observer.phase(self.rig.clock.now_us(), Phase(phase))


def _name_of(method: Callable[[A], object]) -> str:
    owner = type(getattr(method, "__self__", method)).__name__
    return f"{owner}.{getattr(method, '__name__', '')}"


def _repeat(last: Command, why: str) -> Command:
    return Command(
        q_rad=last.q_rad, predicted_mm=last.predicted_mm, outcome=Outcome.HELD, detail=why
    )
