"""The control loop: one path, one controller, one robot.

Timing, the same for every controller: the command of step i is given at the start of period i and
aims at f_i; the error of step i is taken at the end of that period, before the next command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ccr_host.config import Description
from ccr_host.control.base import (
    APPROACH_PERIOD_S,
    Approaching,
    Command,
    Controller,
    Observation,
    Outcome,
)
from ccr_host.errors import TrackerError
from ccr_host.robot.reference import Reference
from ccr_host.run.clock import Stopwatch
from ccr_host.run.observer import RunObserver
from ccr_host.run.operator import NoOperator, Operator
from ccr_host.run.rig import Rig
from ccr_host.run.step_record import StepRecord, Vector
from ccr_host.tracking.marker_check import MarkerCheck
from ccr_host.tracking.sample import Sample

_SOLVE_SHARE_OF_PERIOD = 0.5
"""A command later than this share of its period is dropped; the last one stays."""
_VALIDITY_LIMITS_MS = (200, 10_000)
"""The lower one rides out a busy host, the upper one is the protocol's."""

_BEAT_US = 100_000
"""A multiple of the board's tick and of the usual camera's period."""
_FIRST_SAMPLE_TIMEOUT_US = 5_000_000
_SAMPLE_POLL_US = 10_000

Progress = Callable[[int, int, StepRecord], None]


def follow_path(
    rig: Rig,
    controller: Controller,
    reference: Reference,
    description: Description,
    observer: RunObserver,
    on_step: Progress,
    operator: Operator | None = None,
) -> list[StepRecord]:
    """Arm the robot, approach the first point, follow the path, disarm.

    While the operator wants a pause, the path's clock waits and the pose is held.

    Returns:
        One record for each step of the reference.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers were lost for longer than coasting and holding allow.
    """
    run = _PathRun(rig, controller, reference, description, observer, operator or NoOperator())
    return run.execute(on_step)


class _PathRun:
    def __init__(
        self,
        rig: Rig,
        controller: Controller,
        reference: Reference,
        description: Description,
        observer: RunObserver,
        operator: Operator,
    ) -> None:
        self._rig = rig
        self._controller = controller
        self._reference = reference
        self._observer = observer
        self._operator = operator
        self._settle_s = description.control.settle_s
        self._period_us = round(reference.period_s * 1e6)
        self._validity_ms = int(
            np.clip(
                description.link.target_validity_periods * reference.period_s * 1e3,
                *_VALIDITY_LIMITS_MS,
            )
        )
        self._watch = _MarkerWatch(rig, description)

    def execute(self, on_step: Progress) -> list[StepRecord]:
        rig, clock = self._rig, self._rig.clock
        self._note("looking for the markers")
        self._watch.wait_for_markers()
        self._note("arming")
        rig.client.arm()
        self._wait_for_whole_beat()
        self._note("approaching the first point")
        command = self._controller.start(self._reference)
        self._observer.control(clock.now_us(), None, command)
        leads = self._controller if isinstance(self._controller, Approaching) else None
        if leads is None:
            self._hold_command(command, round(self._settle_s * 1e6))
        else:
            command = self._approach(leads, command)
        self._wait_for_whole_beat()
        start_us = clock.now_us()
        rig.start_path_clock(start_us)
        self._watch.start()
        self._note("following the path")
        records: list[StepRecord] = []
        steps = len(self._reference.time_s)
        timing = _Timing(solve_us=0.0, late=False)
        for step in range(steps):
            if self._operator.wants_pause:
                start_us += self._pause(command)
                rig.start_path_clock(start_us)
            if step > 0 or leads is not None:
                command, timing = self._next_command(step, command)
            self._send(command)
            clock.sleep_until_us(start_us + (step + 1) * self._period_us)
            record = self._judge(step, command, timing)
            self._observer.step(record)
            on_step(step, steps, record)
            records.append(record)
        self._note("disarming")
        rig.client.disarm()
        return records

    def _wait_for_whole_beat(self) -> None:
        """Boards take different times to start; from here on their runs can be compared."""
        clock = self._rig.clock
        clock.sleep_until_us(-(-clock.now_us() // _BEAT_US) * _BEAT_US)

    def _hold_command(self, command: Command, duration_us: int) -> None:
        """Repeat a command often enough to keep the board's watchdog fed."""
        clock = self._rig.clock
        end_us = clock.now_us() + duration_us
        while clock.now_us() < end_us:
            self._send(command)
            clock.sleep_until_us(min(end_us, clock.now_us() + self._validity_ms * 1000 // 2))

    def _approach(self, controller: Approaching, command: Command) -> Command:
        """Let the controller lead the robot to the first point; the last command it gave."""
        clock = self._rig.clock
        self._watch.start()
        while True:
            due_us = clock.now_us()
            tip_mm, age_us, must_hold = self._watch.look()
            if not must_hold:
                observation = self._observation(0, due_us, tip_mm, age_us)
                led = controller.approach(observation)
                if led is None:
                    return command
                command = led
                self._observer.control(due_us, observation, command)
            self._send(command)
            clock.sleep_until_us(due_us + round(APPROACH_PERIOD_S * 1e6))

    def _pause(self, command: Command) -> int:
        """Hold the pose until the operator continues; by how much the path is late, us."""
        clock, held = self._rig.clock, replace(command, ramp_s=0.0)
        since_us = resend_us = clock.now_us()
        self._note("paused")
        while self._operator.wants_pause and not self._operator.wants_stop:
            if clock.now_us() >= resend_us:
                self._send(held)
                resend_us += self._validity_ms * 1000 // 2
            self._watch.fresh_sample()
            clock.idle()
        pause_us = -(-(clock.now_us() - since_us) // _BEAT_US) * _BEAT_US
        clock.sleep_until_us(since_us + pause_us)
        self._watch.start()
        self._note("following the path")
        return pause_us

    def _next_command(self, step: int, last: Command) -> tuple[Command, _Timing]:
        clock = self._rig.clock
        due_us = clock.now_us()
        tip_mm, age_us, must_hold = self._watch.look()
        if must_hold:
            return _repeat(last, "markers lost"), _Timing(solve_us=0.0, late=False)
        observation = self._observation(step, due_us, tip_mm, age_us)
        stopwatch = Stopwatch()
        command = self._controller.step(observation)
        timing = _Timing(stopwatch.elapsed_us(), late=False)
        self._observer.control(due_us, observation, command)
        if clock.now_us() - due_us > _SOLVE_SHARE_OF_PERIOD * self._period_us:
            return _repeat(last, "solver late"), _Timing(timing.solve_us, late=True)
        return command, timing

    def _observation(
        self, step: int, time_us: int, tip_mm: Vector | None, age_us: int
    ) -> Observation:
        return Observation(step, time_us, tip_mm, age_us, self._rig.client.accepted_rad)

    def _send(self, command: Command) -> None:
        self._rig.client.set_target(
            command.q_rad, ramp_ms=round(command.ramp_s * 1e3), validity_ms=self._validity_ms
        )

    def _judge(self, step: int, command: Command, timing: _Timing) -> StepRecord:
        sample = self._watch.fresh_sample()
        now_us = self._rig.clock.now_us()
        return StepRecord(
            step=step,
            end_us=now_us,
            time_s=float(self._reference.time_s[step]),
            target_mm=self._reference.target_mm[step],
            q_rad=command.q_rad,
            outcome=command.outcome,
            detail=command.detail,
            predicted_mm=command.predicted_mm,
            solve_us=timing.solve_us,
            late=timing.late,
            measured_mm=None if sample is None else sample.tip_mm,
            measured_age_us=None if sample is None else now_us - sample.exposed_us,
            true_mm=self._rig.true_tip_mm(),
        )

    def _note(self, text: str) -> None:
        self._observer.event(self._rig.clock.now_us(), text)


@dataclass(frozen=True)
class _Timing:
    solve_us: float
    late: bool


def _repeat(last: Command, why: str) -> Command:
    return Command(
        q_rad=last.q_rad, predicted_mm=last.predicted_mm, outcome=Outcome.HELD, detail=why
    )


class _MarkerWatch:
    """Decides what a missing sample means: coast on the model, hold the pose, give up."""

    def __init__(self, rig: Rig, description: Description) -> None:
        control = description.control
        self._rig = rig
        self._check = MarkerCheck(description)
        self._fits = False
        self._stale_us = control.stale_after_ms * 1000
        self._coast_us = control.coast_s * 1e6
        self._hold_us = control.hold_s * 1e6
        self._last_exposed_us: int | None = None
        self._last_seen_us = 0

    def wait_for_markers(self) -> None:
        clock = self._rig.clock
        deadline_us = clock.now_us() + _FIRST_SAMPLE_TIMEOUT_US
        while self.fresh_sample() is None:
            if clock.now_us() >= deadline_us:
                raise self._lost(_FIRST_SAMPLE_TIMEOUT_US)
            clock.sleep_until_us(clock.now_us() + _SAMPLE_POLL_US)

    def start(self) -> None:
        """The robot moves; count from now on how long the markers are lost."""
        self._check.robot_moves()
        self._last_seen_us = self._rig.clock.now_us()

    def fresh_sample(self) -> Sample | None:
        sample = self._rig.tracker.newest()
        if sample is None or self._rig.clock.now_us() - sample.exposed_us > self._stale_us:
            return None
        if sample.exposed_us != self._last_exposed_us:
            self._last_exposed_us = sample.exposed_us
            self._fits = self._check.accepts(sample)
            if self._fits:
                self._last_seen_us = sample.exposed_us
        return sample if self._fits else None

    def look(self) -> tuple[Vector | None, int, bool]:
        """Newest measurement or None, its age in us or 0, and whether the pose must be held."""
        sample = self.fresh_sample()
        now_us = self._rig.clock.now_us()
        if sample is not None:
            return sample.tip_mm, now_us - sample.exposed_us, False
        lost_us = now_us - self._last_seen_us
        if lost_us > self._coast_us + self._hold_us:
            raise self._lost(lost_us)
        return None, 0, lost_us > self._coast_us

    def _lost(self, lost_us: int) -> TrackerError:
        trouble = self._rig.tracker.trouble()
        return TrackerError(
            f"no markers from {self._rig.tracker.name} for {lost_us / 1e6:.1f} s that were "
            f"younger than {self._stale_us // 1000} ms" + (f": {trouble}" if trouble else ""),
            "check line of sight and the camera's volume; "
            "for a slow tracker raise control.stale_after_ms",
        )
