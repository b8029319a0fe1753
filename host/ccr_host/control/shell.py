"""The common part of all feedback laws, so that they differ only in the law.

The shell leads the robot to the first point, times commands and measurements, respects limits and
rates, adopts the command that the board reports, and rejects missing or implausible measurements.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ccr_host.control.base import APPROACH_PERIOD_S, Command, Observation, Outcome, Phase, Picture
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.link.messages import TICK_PHASE_US, TICK_US
from ccr_host.robot.reference import Reference
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

_LINK_US = 1000
"""Time of a target on the wire and of its processing by the board."""
COMMAND_DELAY_S = (_LINK_US + TICK_US / 2 + (TICK_US - TICK_PHASE_US)) * 1e-6
"""Mean time from a command to the start of its motion, 13 ms: the link, half a servo frame until
the board's next tick, and the time from the tick to its pulses. The twin's shafts are 6 to 16 ms
behind their commands. The age of a measurement contains the camera's latency."""
_LONGEST_RAMP_S = 0.5
_RAMP_SHARE = 0.8
"""Length of a ramp as a fraction of the period; steps would make the structure oscillate."""
_MEAN_RATE_RAD_S = np.radians(60.0)
_SHORTEST_MOVE_S = 0.7
"""Two periods of the structure's slowest oscillation, so that a move does not excite it."""
_FARTHEST_LENGTHS = 2.0
"""Measurements further away than this many lengths of the robot are ignored."""
_LONGEST_ERROR_MM = 40.0
"""Larger errors are reduced to this: more than the 30 mm by which the model alone misses the path,
less than the error of a confused marker."""
_OTHER_COMMAND_RAD = np.radians(0.05)
"""Difference, above the link's rounding, that shows that the board holds another command."""
_US_PER_S = 1e6
NOTHING_MM = np.empty((0, 3))


class PathView:
    """Interpolates a reference at fractional step indices, which are clamped to its ends."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self._samples = np.arange(len(reference), dtype=np.float64)
        self.period_s = reference.period_s
        self.last = len(reference) - 1.0

    def target_mm(self, index: float) -> Array:
        """Desired tip, (3,)."""
        return self._between(index, self.reference.target_mm)

    def reachable_rad(self, index: float) -> Array:
        """Nearest reachable motor angles by constant curvature, (n,)."""
        return self._between(index, self.reference.q_rad)

    def _between(self, index: float, rows: Array) -> Array:
        return np.array([np.interp(index, self._samples, column) for column in rows.T])


@dataclass(frozen=True)
class Measurement:
    """A new measurement, and the setpoint in effect when it was taken."""

    ends_mm: Array
    """Ends of the segments relative to M1, (S, 3); NaN where not seen. The last one, the tip, is
    finite."""
    exposed_s: float
    """Time of exposure on the clock of the run."""
    time_s: float
    """Time of the commands whose effect it shows: the exposure minus the law's delay."""
    setpoint_rad: Array
    """Setpoint in effect at ``time_s``, (n,)."""
    index: float | None
    """Step index that this setpoint aimed at; None if it followed no path."""
    clock_index: float | None
    """Step index of the path's clock at the exposure; None in an approach."""
    elapsed_s: float
    """Time since the previous measurement; for the first one, the period of the commands."""

    @property
    def tip_mm(self) -> Array:
        """Tip relative to M1, (3,), finite."""
        tip: Array = self.ends_mm[-1]
        return tip


@dataclass(frozen=True)
class Plan:
    """Motor angles to move to, (n,), and the predicted tips, (k, 3)."""

    q_rad: Array
    predicted_mm: Array
    detail: str = ""
    """A remark for the log."""


@dataclass(frozen=True)
class Stage:
    """A part of the approach: one setpoint per approach period, (K, n)."""

    name: str
    setpoints_rad: Array
    is_motion: bool = True
    """Whether its progress can be shown."""


class Law(ABC):
    """A feedback law; ``Shell`` handles time, limits and lost markers.

    A law must define its ``name``.
    """

    name: str
    settle_s = 0.0
    """Duration of the rest at the first point."""
    feedback_s = 6.0
    """Duration of feedback at the first point, before the path's clock starts."""

    @property
    def delay_s(self) -> float:
        """Estimated time from a command to the start of its motion."""
        return COMMAND_DELAY_S

    def start(self, path: PathView, history: SetpointHistory) -> None:
        """Reset the law for a new path.

        The shell keeps ``history``, the setpoints of the commands, up to date.
        """
        self.path = path
        self.history = history

    def first_rad(self) -> Array:
        """Motor angles at the first point, (n,), by the present estimate."""
        return self.path.reachable_rad(0.0)

    def stages(self) -> Iterator[Stage]:
        """Yield the parts of the approach before the feedback, each when it begins."""
        here_rad, first_rad = self.history.at(math.inf), self.first_rad()
        moves_rad = smooth_moves(here_rad, first_rad[None], self.settle_s)
        yield Stage("approaching the first point", moves_rad)

    @abstractmethod
    def observe(self, measurement: Measurement) -> None:
        """Process a measurement."""

    def plan(self, index: float, commanded_rad: Array, time_s: float) -> Plan:
        """Plan the command that reaches step ``index`` of the path when it has taken effect.

        The default repeats the last command.

        Args:
            index: fractional step.
            commanded_rad: the last command, (n,).
            time_s: present time on the clock of the measurements.
        """
        return Plan(commanded_rad, NOTHING_MM)


class Shell:
    """The controller that runs a feedback law and approaches the first point under feedback.

    Commands respect the motor limits and the servo's rate. Each aims at the point of the path that
    is current when it has taken effect. Without measurements the law continues on its estimate.
    """

    def __init__(self, description: Description, law: Law) -> None:
        self.law = law
        self.name = law.name
        self._limits = MotorLimits.of(description.servo)
        self._slew_rad_s = np.radians(description.servo.slew_deg_s)
        robot = description.robot
        self._segments = len(robot.chain)
        length_mm = sum(robot.segment_lengths_mm) + 2.0 * robot.marker_offset_mm
        self._farthest_mm = _FARTHEST_LENGTHS * length_mm

    def start(self, reference: Reference) -> Command:
        """Return the law's pose for the first sample."""
        self._path = PathView(reference)
        self._ramp_s = _ramp_s(reference.period_s)
        self._history = SetpointHistory(np.zeros_like(self._limits.lower_rad))
        self.law.start(self._path, self._history)
        self._last_rad = self._limits.clip(self.law.first_rad())
        self._history.restart(self._last_rad)
        self._is_first = True
        self._stage: Stage | None = None
        self._stages = self.law.stages()
        self._moves: deque[Array] = deque()
        self._feedback_left = round(self.law.feedback_s / APPROACH_PERIOD_S)
        self._seen_us: int | None = None
        return Command(self._last_rad, NOTHING_MM, Outcome.SOLVED, ramp_s=self._ramp_s)

    def approach(self, observation: Observation) -> Command | None:
        """Make the law's preparations, move smoothly to the first pose, apply feedback there.

        Returns None once the path may begin.
        """
        self._synchronise(observation)
        seen = self._look(observation, APPROACH_PERIOD_S, None)
        if not self._moves and (stage := next(self._stages, None)) is not None:
            self._stage, self._moves = stage, deque(stage.setpoints_rad)
        if self._moves:
            self._last_rad = self._limits.clip(self._moves.popleft())
            self._note(observation, None, APPROACH_PERIOD_S)
            return Command(
                self._last_rad,
                NOTHING_MM,
                Outcome.SOLVED,
                ramp_s=APPROACH_PERIOD_S,
                phase=self._phase(),
            )
        if self._feedback_left == 0:
            return None
        self._feedback_left -= 1
        return self._command(observation, 0.0, APPROACH_PERIOD_S, seen)

    def step(self, observation: Observation) -> Command:
        """Return the command for a measurement; never raises on bad measurements."""
        self._synchronise(observation)
        period_s = self._path.period_s
        # The end of period i, when f_i is aimed at, is the beginning of step i + 1.
        seen = self._look(observation, period_s, observation.step - 1.0)
        periods_to_effect = (self.law.delay_s + self._ramp_s) / period_s
        index = min(observation.step + max(0.0, periods_to_effect - 1.0), self._path.last)
        return self._command(observation, index, period_s, seen)

    def _synchronise(self, observation: Observation) -> None:
        """Adopt the command that the board holds if it is not the last one."""
        accepted_rad = observation.q_rad
        if not np.isfinite(accepted_rad).all():
            return
        if self._is_first:
            self._last_rad = self._limits.clip(accepted_rad)
            self._history.restart(self._last_rad)
        elif np.abs(accepted_rad - self._last_rad).max() > _OTHER_COMMAND_RAD:
            self._last_rad = self._limits.clip(accepted_rad)
            self._note(observation, None, self._ramp_s)
        self._is_first = False

    def _look(self, observation: Observation, period_s: float, step: float | None) -> bool:
        """Pass what is new to the law as one measurement; return whether the newest is fresh."""
        pictures = [one for one in observation.earlier if self._can_be(one.tip_mm)]
        tip_mm = observation.tip_mm
        seen = tip_mm is not None and self._can_be(tip_mm)
        if tip_mm is not None and seen:
            pictures.append(Picture(tip_mm, observation.tip_age_us, observation.ends_mm))
        news = []
        for picture in pictures:
            exposed_us = observation.time_us - picture.age_us
            if self._seen_us is not None and exposed_us <= self._seen_us:
                continue
            before_us, self._seen_us = self._seen_us, exposed_us
            exposed_s, age_s = _seconds(exposed_us), _seconds(picture.age_us)
            time_s = exposed_s - self.law.delay_s
            news.append(
                Measurement(
                    all_ends_mm(self._segments, picture.ends_mm, picture.tip_mm),
                    exposed_s,
                    time_s,
                    self._history.at(time_s),
                    self._history.index_at(time_s),
                    None if step is None else step - age_s / self._path.period_s,
                    period_s if before_us is None else _seconds(exposed_us - before_us),
                )
            )
        if news:
            self.law.observe(news[0] if len(news) == 1 else _at_rest(news))
        return seen

    def _can_be(self, tip_mm: Array) -> bool:
        return bool(np.all(np.abs(tip_mm) < self._farthest_mm))

    def _phase(self) -> Phase | None:
        stage = self._stage
        if stage is None:
            return None
        done = 1.0 - len(self._moves) / len(stage.setpoints_rad)
        return Phase(stage.name, done if stage.is_motion else None)

    def _command(
        self, observation: Observation, index: float, period_s: float, seen: bool
    ) -> Command:
        time_s = _seconds(observation.time_us)
        plan = self.law.plan(index, self._last_rad, time_s)
        if not np.isfinite(plan.q_rad).all():
            plan = Plan(self._last_rad, NOTHING_MM)
        most_rad = self._slew_rad_s * period_s
        move_rad = np.clip(plan.q_rad - self._last_rad, -most_rad, most_rad)
        self._last_rad = self._limits.clip(self._last_rad + move_rad)
        ramp_s = _ramp_s(period_s)
        self._note(observation, index, ramp_s)
        outcome = Outcome.SOLVED if seen else Outcome.COASTED
        return Command(self._last_rad, plan.predicted_mm, outcome, plan.detail, ramp_s)

    def _note(self, observation: Observation, index: float | None, ramp_s: float) -> None:
        self._history.command(_seconds(observation.time_us), self._last_rad, ramp_s, index)


def believable(error_mm: Array) -> Array:
    """An error, (3,), reduced to the largest plausible length."""
    length_mm = float(np.linalg.norm(error_mm))
    return (
        error_mm if length_mm <= _LONGEST_ERROR_MM else error_mm * (_LONGEST_ERROR_MM / length_mm)
    )


def smooth_moves(
    start_rad: Array, stops_rad: Array, rest_s: Array | float, tick_s: float = APPROACH_PERIOD_S
) -> Array:
    """Setpoints, one per tick, (K, n), from stop to stop, (N, n), with a rest at each, (N,) or ().

    Rate and acceleration of the moves are continuous.
    """
    setpoints = []
    here = start_rad
    for stop, stays_s in zip(stops_rad, np.broadcast_to(rest_s, len(stops_rad)), strict=True):
        farthest = float(np.abs(stop - here).max())
        ticks = int(np.ceil(max(_SHORTEST_MOVE_S, farthest / _MEAN_RATE_RAD_S) / tick_s))
        share = np.arange(1, ticks + 1) / ticks
        smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        setpoints.append(here + smooth[:, None] * (stop - here))
        setpoints.append(np.repeat(stop[None], int(np.ceil(stays_s / tick_s)), axis=0))
        here = stop
    return np.concatenate(setpoints)


def _at_rest(news: list[Measurement]) -> Measurement:
    """The median of the measurements at the newest one's setpoint, at the middle of their times.

    Noise, vibration and single outliers average out. On the move it is the newest measurement.
    """
    rest = [one for one in news if np.array_equal(one.setpoint_rad, news[-1].setpoint_rad)]
    return replace(
        rest[len(rest) // 2],
        ends_mm=median_of_seen(np.array([one.ends_mm for one in rest])),
        elapsed_s=sum(one.elapsed_s for one in news),
    )


def all_ends_mm(segments: int, ends_mm: Array, tip_mm: Array) -> Array:
    """The ends of all segments, (S, 3), from those of the first ones and the tip, (3,)."""
    all_mm = np.full((segments, 3), np.nan)
    all_mm[: len(ends_mm)] = ends_mm
    all_mm[-1] = tip_mm
    return all_mm


def median_of_seen(ends_mm: Array) -> Array:
    """Median of each end, (S, 3), over the pictures that show it, (K, S, 3); NaN if none does."""
    seen = (one[np.isfinite(one).all(axis=1)] for one in np.swapaxes(ends_mm, 0, 1))
    return np.array([np.median(one, axis=0) if len(one) else np.full(3, np.nan) for one in seen])


def _ramp_s(period_s: float) -> float:
    return min(_RAMP_SHARE * period_s, _LONGEST_RAMP_S)


def _seconds(time_us: int) -> float:
    return time_us / _US_PER_S
