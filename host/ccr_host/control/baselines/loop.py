"""What all peers share: the approach, delays, limits, and measurements that are missing or mad."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import APPROACH_PERIOD_S, Command, Observation, Outcome
from ccr_host.control.baselines.command_log import CommandLog
from ccr_host.control.baselines.law import Law, PathView, Plan, Sight
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

FloatArray = NDArray[np.float64]

_COMMAND_DELAY_S = 0.04
"""From a command to the start of its motion: transport, a tick of the board, a servo pulse."""
_LONGEST_RAMP_S = 0.5
_RAMP_SHARE = 0.8
"""Of the period: a ramp ends before the next command; steps would set the structure swinging."""
_APPROACH_RATE_RAD_S = np.radians(60.0)
_SHORTEST_MOVE_S = 0.7
_FEEDBACK_S = 6.0
"""At the first point before the path's clock starts."""
_FARTHEST_LENGTHS = 2.0
"""A measurement further off than so many lengths of the robot is none."""
_OTHER_COMMAND_RAD = np.radians(0.05)
"""Above the rounding of the link: the board holds another command than the last one."""
_US_PER_S = 1e6


class PeerLoop:
    """A controller of a feedback law; approaches the first point under feedback.

    Commands lie within the motor limits and within the servo's rate of each other. Each aims as
    far along the path as the robot will be once it has taken effect. Without measurements the law
    goes on with what it knows.
    """

    name: str

    def __init__(self, description: Description, law: Law) -> None:
        self._law = law
        self._limits = MotorLimits.of(description.servo)
        self._slew_rad_s = np.radians(description.servo.slew_deg_s)
        robot = description.robot
        length_mm = sum(robot.segment_lengths_mm) + 2.0 * robot.marker_offset_mm
        self._farthest_mm = _FARTHEST_LENGTHS * length_mm

    def start(self, reference: Reference) -> Command:
        """The nearest reachable configuration of the first sample."""
        self._path = PathView(reference)
        self._law.start(self._path)
        self._ramp_s = min(_RAMP_SHARE * reference.period_s, _LONGEST_RAMP_S)
        self._log: CommandLog | None = None
        self._moves: deque[FloatArray] = deque()
        self._feedback_left = round(_FEEDBACK_S / APPROACH_PERIOD_S)
        self._seen_us: int | None = None
        self._last_rad = self._limits.clip(self._path.reachable_rad(0.0))
        return Command(self._last_rad, np.empty((0, 3)), Outcome.SOLVED, ramp_s=self._ramp_s)

    def approach(self, observation: Observation) -> Command | None:
        """A smooth move to the first pose, then feedback; None once the path may begin."""
        is_first = self._log is None
        log = self._synchronised(observation)
        if is_first:
            self._moves = deque(_smooth_move(self._last_rad, self._path.reachable_rad(0.0)))
        seen = self._look(observation, log, APPROACH_PERIOD_S)
        if self._moves:
            self._last_rad = self._limits.clip(self._moves.popleft())
            log.command(_seconds(observation.time_us), self._last_rad, None, APPROACH_PERIOD_S)
            return Command(
                self._last_rad, np.empty((0, 3)), Outcome.SOLVED, ramp_s=APPROACH_PERIOD_S
            )
        if self._feedback_left == 0:
            return None
        self._feedback_left -= 1
        ramp_s = _RAMP_SHARE * APPROACH_PERIOD_S
        return self._command(observation, log, 0.0, APPROACH_PERIOD_S, ramp_s, seen)

    def step(self, observation: Observation) -> Command:
        """Measurement in, command out; never raises on bad measurements."""
        log = self._synchronised(observation)
        period_s = self._path.period_s
        seen = self._look(observation, log, period_s)
        periods_to_effect = (_COMMAND_DELAY_S + self._ramp_s) / period_s
        index = min(observation.step + max(0.0, periods_to_effect - 1.0), self._path.last)
        return self._command(observation, log, index, period_s, self._ramp_s, seen)

    def _synchronised(self, observation: Observation) -> CommandLog:
        """The log, after noting what the board holds if that is not the last command."""
        accepted_rad = observation.q_rad
        known = bool(np.isfinite(accepted_rad).all())
        if self._log is None:
            if known:
                self._last_rad = self._limits.clip(accepted_rad)
            self._log = CommandLog(self._last_rad)
        elif known and np.abs(accepted_rad - self._last_rad).max() > _OTHER_COMMAND_RAD:
            self._last_rad = self._limits.clip(accepted_rad)
            self._log.command(_seconds(observation.time_us), self._last_rad, None, self._ramp_s)
        return self._log

    def _look(self, observation: Observation, log: CommandLog, period_s: float) -> bool:
        """Let the law see a new measurement; whether there was any, new or not."""
        tip_mm = observation.tip_mm
        if tip_mm is None or not np.all(np.abs(tip_mm) < self._farthest_mm):
            return False
        exposed_us = observation.time_us - observation.tip_age_us
        if self._seen_us is None or exposed_us > self._seen_us:
            before_us, self._seen_us = self._seen_us, exposed_us
            elapsed_s = period_s if before_us is None else _seconds(exposed_us - before_us)
            setpoint_rad, index = log.at(_seconds(exposed_us) - _COMMAND_DELAY_S)
            self._law.observe(Sight(tip_mm, setpoint_rad, index, elapsed_s))
        return True

    def _command(
        self,
        observation: Observation,
        log: CommandLog,
        index: float,
        period_s: float,
        ramp_s: float,
        seen: bool,
    ) -> Command:
        plan = self._law.plan(index, self._last_rad)
        if not np.isfinite(plan.q_rad).all():
            plan = Plan(self._last_rad, np.empty((0, 3)))
        most_rad = self._slew_rad_s * period_s
        move_rad = np.clip(plan.q_rad - self._last_rad, -most_rad, most_rad)
        self._last_rad = self._limits.clip(self._last_rad + move_rad)
        log.command(_seconds(observation.time_us), self._last_rad, index, ramp_s)
        outcome = Outcome.SOLVED if seen else Outcome.COASTED
        return Command(self._last_rad, plan.predicted_mm, outcome, ramp_s=ramp_s)


def _smooth_move(start_rad: FloatArray, stop_rad: FloatArray) -> FloatArray:
    """Setpoints, one an approach period, (K, 2), without a jump in rate or acceleration."""
    duration_s = max(_SHORTEST_MOVE_S, np.abs(stop_rad - start_rad).max() / _APPROACH_RATE_RAD_S)
    count = int(np.ceil(duration_s / APPROACH_PERIOD_S))
    share = np.arange(1, count + 1) / count
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return np.asarray(start_rad + smooth[:, None] * (stop_rad - start_rad))


def _seconds(time_us: int) -> float:
    return time_us / _US_PER_S
