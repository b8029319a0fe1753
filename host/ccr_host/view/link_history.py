"""What the frames on the link tell: the state of the board and the health of the link."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccr_host.core.units import cdeg_to_rad
from ccr_host.link.framing import Frame, FrameDecoder
from ccr_host.link.messages import (
    MESSAGES,
    Fault,
    HelloReply,
    Message,
    PayloadError,
    Request,
    SetTelemetry,
    State,
    StateReport,
    Telemetry,
)
from ccr_host.view.growing import FloatArray, GrowingTable

_KEEP_EVERY_US = 40_000
"""The page draws 20 times a second; changes of the state are always kept."""
_U8 = 1 << 8
_U16 = 1 << 16


class BoardState(NamedTuple):
    """The board as it last reported."""

    time_us: float
    state: State
    fault: Fault
    setpoint_rad: FloatArray
    """(2,): where ramp and slew limit stand."""
    pulses_us: tuple[float, float]
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
    """Takes in every frame, in order."""

    def __init__(self) -> None:
        self._decoders = {"sent": FrameDecoder(), "received": FrameDecoder()}
        self._board = GrowingTable(7)
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
            np.array(numbers[:2]),
            (numbers[2], numbers[3]),
        )

    def health_at(self, time_us: float) -> LinkHealth | None:
        """The newest counts by then."""
        rows = self._health.until(time_us)
        return LinkHealth(*rows[-1]) if len(rows) else None

    def setpoints_until(self, time_us: float) -> FloatArray:
        """(n, 3): time in us, both setpoints in rad."""
        return self._board.until(time_us)[:, [0, 3, 4]]

    def round_trips_until(self, time_us: float) -> FloatArray:
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
        message = _parse(frame)
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
        setpoint_rad = cdeg_to_rad(report.setpoint_cdeg)
        pulses_us = (half_us / 2 for half_us in report.pulse_half_us)
        self._board.append((time_us, report.state, report.fault, *setpoint_rad, *pulses_us))
        trips = self._round_trips.rows
        newest_us = trips[-1, 1] if len(trips) else np.nan
        self._health.append((time_us, *self._counts.values(), self._board_errors, newest_us))


def _parse(frame: Frame) -> Message | None:
    kind = MESSAGES.get(frame.id)
    try:
        return None if kind is None else kind.unpack(frame.payload)
    except PayloadError:
        return None
