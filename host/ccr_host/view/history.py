"""All that the page knows of a run, and how it stood at any time of it.

The live page and the player fill the same history, so whatever can be seen live can be scrubbed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccr_host.control.base import Command, Observation, Phase
from ccr_host.core.arrays import Array
from ccr_host.core.wire import cdeg_to_rad
from ccr_host.link.exchange import message_in
from ccr_host.link.framing import Frame, FrameDecoder
from ccr_host.link.messages import (
    MESSAGES,
    Fault,
    HelloReply,
    Request,
    SetTelemetry,
    State,
    StateReport,
    Telemetry,
)
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.tracking.tracker import Sample

_FIRST_CAPACITY = 256
_KEEP_EVERY_US = 40_000
"""The page draws 20 times a second; changes of the state are always kept."""
_U8 = 1 << 8
_U16 = 1 << 16


class GrowingTable:
    """Rows ordered by their first column, a time in us."""

    def __init__(self, columns: int) -> None:
        self._storage = np.empty((_FIRST_CAPACITY, columns))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, row: Sequence[float] | Array) -> None:
        """Add one row; amortised constant time."""
        if self._count == len(self._storage):
            self._storage = np.concatenate([self._storage, np.empty_like(self._storage)])
        self._storage[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """All rows so far, (N, columns); a view."""
        return self._storage[: self._count]

    def until(self, time_us: float) -> Array:
        """The rows up to a time, (n, columns); a view."""
        count = int(np.searchsorted(self.rows[:, 0], time_us, side="right"))
        return self._storage[:count]


class BoardState(NamedTuple):
    """The board as it last reported."""

    time_us: float
    state: State
    fault: Fault
    setpoint_rad: Array
    """(motors,): where ramp and slew limit stand."""
    pulses_us: tuple[float, ...]
    """0 is no pulse."""


class LinkHealth(NamedTuple):
    """Counts since the run began."""

    time_us: float
    sent: float
    received: float
    retries: float
    lost_telemetry: float
    """Reports of the board that never arrived, damaged ones among them."""
    board_errors: float
    """Frames that arrived damaged at the board: CRC, encoding, size, overruns."""
    round_trip_us: float
    """Newest; NaN before the first."""


class LinkHistory:
    """Takes in every frame, in order.

    ``motors`` are at the first axes of the board.
    """

    def __init__(self, motors: int = 2) -> None:
        self._motors = motors
        self._decoders = {"sent": FrameDecoder(), "received": FrameDecoder()}
        self._board = GrowingTable(3 + 2 * motors)
        self._health = GrowingTable(len(LinkHealth._fields))
        self._round_trips = GrowingTable(2)
        self._counts = dict.fromkeys(("sent", "received", "retries", "lost_telemetry"), 0)
        self._board_errors_at_start: int | None = None
        self._board_errors = 0
        self._last_sent = b""
        self._awaited: dict[int, tuple[int, int]] = {}
        self._telemetry_sequence: int | None = None

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        """Bytes of one frame as sent or received."""
        decoder = self._decoders.get(direction)
        for frame in decoder.feed(data) if decoder else ():
            if not isinstance(frame, Frame):
                continue
            self._counts[direction] += 1
            if direction == "sent":
                self._note_sent(frame, time_us, data)
            else:
                self._note_received(frame, time_us)

    def board_at(self, time_us: float) -> BoardState | None:
        """The newest report by then."""
        rows = self._board.until(time_us)
        if not len(rows):
            return None
        at_us, state, fault, *numbers = rows[-1]
        return BoardState(
            at_us,
            State(int(state)),
            Fault(int(fault)),
            np.array(numbers[: self._motors]),
            tuple(numbers[self._motors :]),
        )

    def health_at(self, time_us: float) -> LinkHealth | None:
        """The newest counts by then."""
        rows = self._health.until(time_us)
        return LinkHealth(*rows[-1]) if len(rows) else None

    def setpoints_until(self, time_us: float) -> Array:
        """(n, 1 + motors): time in us, setpoints in rad."""
        return self._board.until(time_us)[:, [0, *range(3, 3 + self._motors)]]

    def round_trips_until(self, time_us: float) -> Array:
        """(n, 2): time and duration, us."""
        return self._round_trips.until(time_us)

    def _note_sent(self, frame: Frame, time_us: int, data: bytes) -> None:
        kind = MESSAGES.get(frame.id)
        if kind is None or not issubclass(kind, Request):
            return
        if kind is SetTelemetry:
            self._telemetry_sequence = None
        if data == self._last_sent and frame.sequence in self._awaited:
            self._counts["retries"] += 1
            del self._awaited[frame.sequence]  # whose answer comes can no longer be told
        else:
            self._awaited[frame.sequence] = (kind.REPLY_ID, time_us)
        self._last_sent = data

    def _note_received(self, frame: Frame, time_us: int) -> None:
        message = message_in(frame)
        if isinstance(message, HelloReply):
            self._counts["retries"] = 0  # until then a boot loader was deaf
        if isinstance(message, Telemetry):
            self._note_telemetry(message.report, frame.sequence, time_us)
            return
        reply_id, sent_us = self._awaited.get(frame.sequence, (None, 0))
        if reply_id == frame.id:
            del self._awaited[frame.sequence]
            self._round_trips.append((time_us, time_us - sent_us))

    def _note_telemetry(self, report: StateReport, sequence: int, time_us: int) -> None:
        if self._telemetry_sequence is not None:
            self._counts["lost_telemetry"] += (sequence - self._telemetry_sequence - 1) % _U8
        self._telemetry_sequence = sequence
        if self._board_errors_at_start is None:
            self._board_errors_at_start = report.link_errors
        self._board_errors = (report.link_errors - self._board_errors_at_start) % _U16
        if self._is_worth_keeping(report, time_us):
            self._keep(report, time_us)

    def _is_worth_keeping(self, report: StateReport, time_us: int) -> bool:
        if not len(self._board):
            return True
        last = self._board.rows[-1]
        return time_us - last[0] >= _KEEP_EVERY_US or tuple(last[1:3]) != (
            report.state,
            report.fault,
        )

    def _keep(self, report: StateReport, time_us: int) -> None:
        setpoint_rad = cdeg_to_rad(report.setpoint_cdeg[: self._motors])
        pulses_us = (half_us / 2 for half_us in report.pulse_half_us[: self._motors])
        self._board.append((time_us, report.state, report.fault, *setpoint_rad, *pulses_us))
        trips = self._round_trips.rows
        newest_us = trips[-1, 1] if len(trips) else np.nan
        self._health.append((time_us, *self._counts.values(), self._board_errors, newest_us))


class StepColumns(NamedTuple):
    """One row a control step."""

    end_us: Array
    error_mm: Array
    """|f_m - f|; NaN where nothing was measured."""
    true_error_mm: Array
    """NaN without a twin."""
    unavoidable_mm: Array
    """Error that the model cannot avoid."""
    solve_us: Array
    age_us: Array
    """Age of the sample; NaN where the markers were lost."""
    late: Array
    """1 where the command came too late."""


@dataclass(frozen=True)
class Moment:
    """A run at one time of it."""

    time_us: float
    phase: Phase | None
    """Phase of the run."""
    record: StepRecord | None
    """The last step that has ended."""
    horizon_mm: Array
    """(k, 3): where the newest command expects the tip, from the end of its period on."""
    markers_mm: Array | None
    """(markers, 3), newest whole sample, M1 is the origin; None where it is too old to believe."""
    markers_age_us: float
    """Age of that sample; NaN before the first."""
    board: BoardState | None
    link: LinkHealth | None
    steps: StepColumns
    trail_mm: Array
    """(n, 3): measured tip at the end of each step; NaN where it was not measured."""


class RunHistory(RunObserver):
    """An observer that keeps what it sees."""

    def __init__(self) -> None:
        self.setup: RunSetup | None = None
        self.link = LinkHistory()
        self._steps = GrowingTable(len(StepColumns._fields))
        self._trail = GrowingTable(4)
        self._records: list[StepRecord] = []
        self._command_us = GrowingTable(1)
        self._horizons_mm: list[Array] = []
        self._samples = GrowingTable(10)
        self._phases: list[tuple[int, Phase]] = []
        self._stale_us = math.inf
        self.end_us = 0

    def begin(self, setup: RunSetup) -> None:
        self.setup = setup
        self._stale_us = setup.description.control.stale_after_ms * 1000.0
        robot = setup.description.robot
        self.link = LinkHistory(robot.motors)
        self._samples = GrowingTable(1 + 3 * len(robot.markers))

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        self.link.frame(direction, time_us, data)
        self.end_us = max(self.end_us, time_us)

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        relative_mm = sample.markers_mm - sample.markers_mm[0]
        if np.isfinite(relative_mm).all():
            self._samples.append((time_us, *relative_mm.ravel()))
        self.end_us = max(self.end_us, time_us)

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        self._command_us.append((time_us,))
        self._horizons_mm.append(command.predicted_mm)

    def step(self, record: StepRecord) -> None:
        measured_mm = _or_nan(record.measured_mm)
        self._records.append(record)
        self._trail.append((record.end_us, *measured_mm))
        self._steps.append(
            (  # in the order of StepColumns
                record.end_us,
                float(np.linalg.norm(measured_mm - record.target_mm)),
                float(np.linalg.norm(_or_nan(record.true_mm) - record.target_mm)),
                self._unavoidable_mm(record.step),
                record.solve_us,
                math.nan if record.measured_age_us is None else record.measured_age_us,
                record.late,
            )
        )
        self.end_us = max(self.end_us, record.end_us)

    def event(self, time_us: int, text: str) -> None:
        self.end_us = max(self.end_us, time_us)

    def phase(self, time_us: int, phase: Phase) -> None:
        self._phases.append((time_us, phase))
        self.end_us = max(self.end_us, time_us)

    def at(self, time_us: float) -> Moment:
        """The run at a time; everything later is left out."""
        steps = self._steps.until(time_us)
        samples = self._samples.until(time_us)
        age_us = time_us - samples[-1, 0] if len(samples) else math.nan
        commands = len(self._command_us.until(time_us))
        return Moment(
            time_us=time_us,
            phase=next((one for at_us, one in reversed(self._phases) if at_us <= time_us), None),
            record=self._records[len(steps) - 1] if len(steps) else None,
            horizon_mm=self._horizons_mm[commands - 1] if commands else np.empty((0, 3)),
            markers_mm=samples[-1, 1:].reshape(-1, 3) if age_us <= self._stale_us else None,
            markers_age_us=age_us,
            board=self.link.board_at(time_us),
            link=self.link.health_at(time_us),
            steps=StepColumns(*steps.T),
            trail_mm=self._trail.until(time_us)[:, 1:],
        )

    def _unavoidable_mm(self, step: int) -> float:
        if self.setup is None or step >= len(self.setup.reference):
            return math.nan
        return float(self.setup.reference.unavoidable_mm[step])


def _or_nan(position_mm: Array | None) -> Array:
    return np.full(3, np.nan) if position_mm is None else position_mm
