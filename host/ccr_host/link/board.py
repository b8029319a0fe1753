"""The requests that query and configure a board, one at a time; none of them moves the robot.

And the relation of the board's clock to the host's, which such a request measures.
"""

from __future__ import annotations

from binascii import crc32
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

from ccr_host.core.clock import Clock
from ccr_host.core.errors import DeviceError
from ccr_host.link import messages as m
from ccr_host.link.board_config import BoardConfig, board_name
from ccr_host.link.device_errors import (
    BoardFaultError,
    MissingCapabilityError,
    RequestRefusedError,
    SpecMismatchError,
    TooFewAxesError,
    WrongBoardError,
)
from ccr_host.link.exchange import (
    ANSWER_TIMEOUT_US,
    ATTEMPTS,
    Exchange,
    FrameObserver,
    LinkCounts,
    Received,
    Transport,
)
from ccr_host.link.messages import State

BOOT_TIMEOUT_US = 5_000_000
"""An UNO with its boot loader answers after 1 to 2 s."""
TELEMETRY_TIMEOUT_US = 1_000_000
"""Fifty consecutive reports are not lost by chance."""
STATE_POLL_US = m.TICK_US
_MARGIN_US = 1_000_000
_CHECK_BYTES = 4
_U8 = 1 << 8
_U16 = 1 << 16
_U32 = 1 << 32
_WINDOW = 64
"""Number of exchanges, one every ten seconds; they determine the drift to about 5 ppm."""
_MOST_DRIFT = 0.01
"""Drift of an UNO's ceramic resonator; that of a crystal is a hundredth of it."""
_WANDER = 5e-6
"""Change of the drift itself over a window, as a crystal warms up."""
_SHORTEST_US = 50.0
"""Half round trips shorter than this are weighted as if they took this long."""

R = TypeVar("R", bound=m.Message)
TelemetryObserver = Callable[[m.StateReport, int], None]
"""Called with a report and the host time in us at which it was read."""

_SET: Final[dict[str, Callable[[int, Any], m.Request]]] = {
    "limits": m.SetLimits,
    "slew": m.SetSlew,
    "watchdog": m.SetWatchdog,
    "calibration": m.SetCalibration,
    "acceleration": m.SetAcceleration,
}
"""The request that sets each configuration group."""


@dataclass(frozen=True, slots=True)
class _ClockExchange:
    host_us: int
    """Host time at the middle of the exchange."""
    offset_us: int
    """Board time minus host time, accurate to half the round trip."""
    half_trip_us: float


class BoardClock:
    """Estimates offset and drift of the board's clock from `clock_sync` exchanges.

    Each exchange gives the offset at its time, to half its round trip. A line through the last
    exchanges gives the drift. The offset is extrapolated with this drift from the exchange that
    is least uncertain now, considering its round trip and age. An exchange that contradicts the
    estimate, after a reset of the board or a sleep of the host, discards all earlier ones.
    """

    def __init__(self) -> None:
        self._exchanges: deque[_ClockExchange] = deque(maxlen=_WINDOW)
        self.drift = 0.0
        """Relative rate by which the board's clock is faster than the host's: 1e-6 is 1 ppm."""
        self._drift_error = _MOST_DRIFT

    def add(self, sent_us: int, received_us: int, board_time_us: int) -> None:
        """Add an exchange; the board's 32-bit time is unwrapped by the present estimate."""
        host_us = (sent_us + received_us) // 2
        half_trip_us = max((received_us - sent_us + 1) / 2, _SHORTEST_US)
        offset_us = board_time_us - host_us
        expected_us, uncertainty_us = self.offset_us(host_us), self.uncertainty_us(host_us)
        if expected_us is not None and uncertainty_us is not None:
            away_us = (offset_us - expected_us + _U32 // 2) % _U32 - _U32 // 2
            if abs(away_us) <= half_trip_us + uncertainty_us:
                offset_us = expected_us + away_us
            else:
                self._exchanges.clear()
        self._exchanges.append(_ClockExchange(host_us, offset_us, half_trip_us))
        self._fit_drift()

    def offset_us(self, host_us: int) -> int | None:
        """Board time minus host time, at a host time; None before the first exchange."""
        if not self._exchanges:
            return None
        best = min(self._exchanges, key=lambda exchange: self._error_us(exchange, host_us))
        return best.offset_us + round(self.drift * (host_us - best.host_us))

    def uncertainty_us(self, host_us: int) -> int | None:
        """Bound of the offset's error at a host time; None before the first exchange."""
        if not self._exchanges:
            return None
        least_us = min(self._error_us(exchange, host_us) for exchange in self._exchanges)
        return int(np.ceil(least_us))

    def _error_us(self, exchange: _ClockExchange, host_us: int) -> float:
        return exchange.half_trip_us + self._drift_error * abs(host_us - exchange.host_us)

    def _fit_drift(self) -> None:
        """Fit by weighted least squares; the bound assumes the largest error of each exchange."""
        first = self._exchanges[0]
        time_us = np.array([float(one.host_us - first.host_us) for one in self._exchanges])
        offset_us = np.array([float(one.offset_us - first.offset_us) for one in self._exchanges])
        half_trip_us = np.array([one.half_trip_us for one in self._exchanges])
        weight = half_trip_us**-2.0
        time_us -= np.average(time_us, weights=weight)
        about_drift = float((weight * time_us**2).sum())
        known_before = _MOST_DRIFT**-2.0
        self.drift = float((weight * time_us * offset_us).sum()) / (about_drift + known_before)
        worst = float((np.abs(time_us) / half_trip_us).sum()) + known_before * _MOST_DRIFT
        self._drift_error = min(worst / (about_drift + known_before) + _WANDER, _MOST_DRIFT)


@dataclass(frozen=True, slots=True)
class ReceivedReport:
    """A state report and the host time at which it was read."""

    report: m.StateReport
    time_us: int


def drawn_session(rng: np.random.Generator) -> int:
    """Draw a session number; hosts that share a board need differently seeded generators."""
    return int(rng.integers(1, 1 << 16))


class Board:
    """Sends the protocol's requests and returns their answers.

    Args:
        transport: connection to the board.
        clock: the only source of time.
        session: number that no other host of the board uses, see `drawn_session`.
        on_message: called with each message that answers no pending request.
        on_frame: called with every frame in both directions.
        motors: of the robot, on the first axes of the board; None for all axes.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        session: int,
        on_message: Callable[[Received], None],
        on_frame: FrameObserver | None,
        motors: int | None,
    ) -> None:
        self._clock = clock
        self._session = session
        self._counts = LinkCounts()
        self._exchange = Exchange(transport, clock, self._counts, on_message, on_frame)
        self._identity: m.HelloReply | None = None
        self._newest: ReceivedReport | None = None
        self._motors = motors
        self._telemetry_period_ticks = 0
        self._telemetry_sequence: int | None = None
        self._silence_us = TELEMETRY_TIMEOUT_US
        self._heard_us = self._synced_us = 0
        self.board_clock = BoardClock()

    # Identity and state

    @property
    def identity(self) -> m.HelloReply | None:
        """The board's answer to hello; None before :meth:`connect`."""
        return self._identity

    def require(self, request: type[m.Request]) -> None:
        """Check that the board knows an optional request.

        Raises:
            MissingCapabilityError: its firmware does not.
        """
        if self._identity and request.CAPABILITY & ~self._identity.capabilities:
            raise MissingCapabilityError(request, self._identity)

    def read_state(self) -> m.StateReport:
        """Read the state; needs no session."""
        report = self._ask(m.GetState(), m.StateReply).report
        return self._keep(report, self._clock.now_us())

    def read_counters(self) -> m.CountersReply:
        """Read the board's counters since its reset; needs no session."""
        return self._ask(m.GetCounters(), m.CountersReply)

    @property
    def telemetry(self) -> ReceivedReport | None:
        """Newest report, streamed or requested; None before the first."""
        return self._newest

    def telemetry_age_us(self) -> int | None:
        """Time since the newest report was read; None before the first."""
        return None if self._newest is None else self._clock.now_us() - self._newest.time_us

    def start_telemetry(self, period_ticks: int = 1) -> None:
        """Let the board send a report every `period_ticks`; 0 ends the stream."""
        self._telemetry_sequence = None
        self._exchange.request(m.SetTelemetry(self._session, period_ticks))
        self._telemetry_period_ticks = period_ticks
        self._silence_us = max(TELEMETRY_TIMEOUT_US, 5 * period_ticks * m.TICK_US)
        self._heard_us = self._clock.now_us()

    def sync_clock(self, exchanges: int = 4) -> None:
        self._synced_us = self._clock.now_us()
        for _ in range(exchanges):
            sent_us, retries = self._clock.now_us(), self._counts.retries
            reply = self._ask(m.ClockSync(sent_us % _U32), m.ClockReply)
            if self._counts.retries == retries:
                self.board_clock.add(sent_us, self._clock.now_us(), reply.board_time_us)

    # Configuration

    def read_config(self) -> BoardConfig:
        """Read all groups; a group that is not set reads as zeros."""
        return BoardConfig(
            limits=self._ask(m.GetLimits(), m.LimitsReply).limits,
            slew=self._ask(m.GetSlew(), m.SlewReply).slew,
            watchdog=self._ask(m.GetWatchdog(), m.WatchdogReply).watchdog,
            calibration=self._ask(m.GetCalibration(), m.CalibrationReply).calibration,
            acceleration=self._ask(m.GetAcceleration(), m.AccelerationReply).acceleration,
        )

    def set_config(self, present: BoardConfig, wanted: BoardConfig) -> None:
        """Set the groups that differ, and verify them.

        Raises:
            DeviceError: refused, or read back differently.
        """
        for group, request in _SET.items():
            value = getattr(wanted, group)
            if getattr(present, group) != value:
                self._exchange.request(request(self._session, value))
        if self.read_config() != wanted:
            raise DeviceError(
                "the board does not keep its configuration", "reset it; flash it again"
            )

    def read_equipment(self) -> m.Equipment:
        return self._ask(m.GetEquipment(), m.EquipmentReply).equipment

    def require_name(self, wanted: str) -> None:
        """Check that this is the board named in the description.

        Raises:
            WrongBoardError: it has another name; an empty one fits any board.
        """
        if wanted and (name := board_name(self.read_equipment())) != wanted:
            raise WrongBoardError(name, wanted)

    def set_equipment(self, equipment: m.Equipment) -> None:
        """Set the board's name and what is wired to it; a reset loses both unless they are saved.

        Raises:
            RequestRefusedError: the board is armed or saving, or a value is out of range.
        """
        self._exchange.request(m.SetEquipment(self._session, equipment))

    def save_config(self) -> None:
        """Save the configuration in EEPROM; returns when it is written."""
        self._exchange.request(m.SaveConfig(self._session))
        axes = self._identity.axes if self._identity else m.MAX_AXES
        save_us = m.eeprom_slot_size(axes) * m.TICK_US
        deadline_us = self._clock.now_us() + save_us + _MARGIN_US
        while True:
            self._clock.sleep_until_us(self._clock.now_us() + STATE_POLL_US)
            report = self.read_state()
            if not report.flags & m.StatusFlags.EEPROM_BUSY:
                break
            if self._clock.now_us() > deadline_us:
                raise DeviceError("the board does not finish saving", "reset it and try again")
        if report.fault is m.Fault.EEPROM_FAILED:
            raise BoardFaultError(report.fault)

    def read_fault_log(self) -> list[m.FaultRecord]:
        """Read the last faults from the board's log, newest first; needs no session."""
        records = []
        for place in range(m.FAULT_LOG_RECORDS):
            deadline_us = self._clock.now_us() + _MARGIN_US
            request, busy = m.GetFaultRecord(place), (m.NackCode.BUSY, 0)
            record = self._while_refused(request, busy, m.FaultRecordReply, deadline_us).record
            if crc32(record.pack()[:-_CHECK_BYTES]) == record.check:
                records.append(record)
        newest = max((record.number for record in records), default=0)
        wrapped = newest > _U16 - m.FAULT_LOG_RECORDS
        half = _U16 // 2 if wrapped else 0
        return sorted(records, key=lambda r: (r.number + half) % _U16, reverse=True)

    def blink(self, duration_s: int) -> None:
        """Let the board's LED blink, 0 to 60 s; needs no session."""
        self._exchange.request(m.Blink(duration_s))

    def clear_fault(self) -> None:
        """Acknowledge a fault or a stop; the board is then disarmed.

        Waits while a board that has just latched still ends its pulses.
        """
        deadline_us = self._clock.now_us() + _MARGIN_US
        self._while_refused(m.ClearFault(self._session), (m.NackCode.BUSY, 0), m.Ack, deadline_us)

    # Details

    def _hello(self) -> m.HelloReply:
        hello = m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH)
        return self._ask(hello, m.HelloReply, attempts=BOOT_TIMEOUT_US // ANSWER_TIMEOUT_US)

    def _open_session(self) -> tuple[m.HelloReply, State]:
        """Wait for the board, check its spec, and open a session."""
        deadline_us = self._clock.now_us() + BOOT_TIMEOUT_US
        self._exchange.end_unfinished_frame()
        identity = self._hello()
        self._counts.forget_waiting_for_the_board()
        if (identity.protocol_version, identity.spec_hash) != (m.PROTOCOL_VERSION, m.SPEC_HASH):
            raise SpecMismatchError(identity)
        if self._motors is not None and identity.axes < self._motors:
            raise TooFewAxesError(identity.axes, self._motors)
        self._exchange.limits = self._link_limits(identity)
        request = m.OpenSession(m.SPEC_HASH, self._session)
        booting = (m.NackCode.BAD_STATE, State.BOOT)
        session = self._while_refused(request, booting, m.SessionReply, deadline_us)
        if session.boot_id != identity.boot_id:
            identity = self._hello()
        self._identity = identity
        return identity, session.state

    def _link_limits(self, identity: m.HelloReply) -> m.LinkLimitsReply:
        if identity.capabilities & m.GetLinkLimits.CAPABILITY:
            return self._ask(m.GetLinkLimits(), m.LinkLimitsReply)
        return m.LinkLimitsReply(m.OUTSTANDING_REQUESTS, m.OUTSTANDING_BYTES.of(identity.axes))

    def _while_refused(
        self, request: m.Request, for_now: tuple[m.NackCode, int], reply: type[R], deadline_us: int
    ) -> R:
        """Repeat a request once per tick while the answer is a refusal that is only temporary."""
        while True:
            try:
                return self._ask(request, reply)
            except RequestRefusedError as refusal:
                if (refusal.code, refusal.detail) != for_now or self._clock.now_us() > deadline_us:
                    raise
                self._clock.sleep_until_us(self._clock.now_us() + STATE_POLL_US)

    def _ask(self, request: m.Request, reply: type[R], attempts: int = ATTEMPTS) -> R:
        message = self._exchange.request(request, attempts)
        assert isinstance(message, reply), "each request has one kind of reply"
        return message

    def _keep(self, report: m.StateReport, time_us: int) -> m.StateReport:
        """Keep what a report says of the motors, and return that."""
        if self._motors is not None and len(report.setpoint_cdeg) > self._motors:
            report = report.with_axes(self._motors)
        self._newest = ReceivedReport(report, time_us)
        self._heard_us = time_us
        return report

    def _count_lost_telemetry(self, sequence: int) -> None:
        if self._telemetry_sequence is not None:
            self._counts.lost_telemetry += (sequence - self._telemetry_sequence - 1) % _U8
        self._telemetry_sequence = sequence
