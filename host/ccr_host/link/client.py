"""The host's end of the link: one board, one session, always left in a safe state."""

from __future__ import annotations

from binascii import crc32
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isqrt
from types import TracebackType
from typing import Final, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.clock import NEVER_US, Clock
from ccr_host.core.errors import DeviceError
from ccr_host.core.stop_signals import interruptible_again
from ccr_host.core.units import cdeg_to_rad, rad_to_cdeg
from ccr_host.link import messages as m
from ccr_host.link.board_clock import BoardClock
from ccr_host.link.board_config import BoardConfig, board_name
from ccr_host.link.device_errors import (
    BoardFaultError,
    BoardResetError,
    BoardSilentError,
    BoardStoppedError,
    LinkLossError,
    RequestRefusedError,
    SessionTakenError,
    SpecMismatchError,
    WrongBoardError,
    WrongStateError,
)
from ccr_host.link.exchange import ANSWER_TIMEOUT_US, ATTEMPTS, Exchange, FrameObserver, Received
from ccr_host.link.messages import State
from ccr_host.link.statistics import LinkCounts, LinkStatistics
from ccr_host.link.target_log import TargetLog
from ccr_host.link.transport import Transport

BOOT_TIMEOUT_US = 5_000_000
"""An UNO with its boot loader is there after 1 to 2 s."""
TELEMETRY_TIMEOUT_US = 1_000_000
"""Fifty reports in a row are not lost by chance."""
_LED_TO_REST_US = 5_000_000
"""A gap in the targets is to blame where the board leads the robot to rest within this time."""
_STATE_POLL_US = m.TICK_US
_SYNC_PERIOD_US = 10_000_000
_MARGIN_US = 1_000_000
_STOP_ATTEMPTS = 8
_CHECK_BYTES = 4
_U8 = 1 << 8
_U16 = 1 << 16
_U32 = 1 << 32

R = TypeVar("R", bound=m.Message)

_MOVING_STATES: Final = frozenset(
    {State.ARMING, State.ACTIVE, State.HOLD, State.RELAXING, State.DISARMING}
)

_LATCHED_STATES: Final = frozenset({State.FAULT, State.STOPPED})

TelemetryObserver = Callable[[m.StateReport, int], None]
"""A report and the host time in us at which it was read."""


@dataclass(frozen=True, slots=True)
class ReceivedReport:
    """A state report and the host time at which it was read."""

    report: m.StateReport
    time_us: int


def drawn_session(rng: np.random.Generator) -> int:
    """A session number; two hosts of one board must not draw from generators seeded alike."""
    return int(rng.integers(1, 1 << 16))


class Client:
    """Talks to one board; to be used as a context manager.

    However the `with` block is left, the robot is made safe first: disarmed if the board goes
    along, stopped otherwise. A second Ctrl-C goes straight to the stop.

    It never waits but through the clock. Attached to the clock it also takes in telemetry while
    somebody else waits.

    Args:
        transport: to the board; closed on leaving.
        clock: the only time.
        session: number that no other host of the board has, see `drawn_session`.
        on_frame: sees every frame, both ways.
        on_telemetry: sees every report of the stream.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        session: int,
        *,
        on_frame: FrameObserver | None = None,
        on_telemetry: TelemetryObserver | None = None,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._session = session
        self._on_telemetry = on_telemetry
        self._counts = LinkCounts()
        self._exchange = Exchange(transport, clock, self._counts, self._take, on_frame)
        self._identity: m.HelloReply | None = None
        self._config: BoardConfig | None = None
        self._newest: ReceivedReport | None = None
        self._telemetry_period_ticks = 0
        self._telemetry_sequence: int | None = None
        self._heard_us = 0
        self._fed_us = self._fed_until_us = self._synced_us = 0
        self._gap_us, self._gap_end_us = 0, -_LED_TO_REST_US
        self._targets = TargetLog()
        self._may_move = False
        self._watching = False
        self._closed = False
        self.board_clock = BoardClock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        trouble = self._leave()
        if trouble is None:
            return
        if error is None:
            raise trouble
        error.add_note(f"while leaving: {trouble}")

    # Connection

    def connect(self, telemetry_period_ticks: int = 1) -> m.HelloReply:
        """Wait for the board, check what it is built from, open a session, start telemetry.

        After :class:`SpecMismatchError` reading and :meth:`stop` still work.

        Raises:
            BoardSilentError: nobody answers within `BOOT_TIMEOUT_US`.
            SpecMismatchError: board and host do not fit.
            DeviceError: the port is gone.
        """
        deadline_us = self._clock.now_us() + BOOT_TIMEOUT_US
        self._exchange.end_unfinished_frame()
        identity = self._hello()
        self._counts.forget_waiting_for_the_board()
        if (identity.protocol_version, identity.spec_hash) != (m.PROTOCOL_VERSION, m.SPEC_HASH):
            raise SpecMismatchError(identity)
        session = self._open_session(deadline_us)
        if session.boot_id != identity.boot_id:
            identity = self._hello()
        self._identity = identity
        self._may_move = session.state in _MOVING_STATES
        self._counts.board_at_start = self._counts.board = self.read_counters()
        self.sync_clock()
        if telemetry_period_ticks:
            self.start_telemetry(telemetry_period_ticks)
        return identity

    def start_telemetry(self, period_ticks: int = 1) -> None:
        """Let the board report once in `period_ticks`; 0 ends it."""
        self._telemetry_sequence = None
        self._exchange.request(m.SetTelemetry(self._session, period_ticks))
        self._telemetry_period_ticks = period_ticks
        self._heard_us = self._clock.now_us()

    def sync_clock(self, exchanges: int = 4) -> None:
        """Relate the board's clock to the host's; see `board_clock`."""
        self._synced_us = self._clock.now_us()
        for _ in range(exchanges):
            sent_us, retries = self._clock.now_us(), self._counts.retries
            reply = self._ask(m.ClockSync(sent_us % _U32), m.ClockReply)
            if self._counts.retries == retries:
                self.board_clock.add(sent_us, self._clock.now_us(), reply.board_time_us)

    # Configuration

    def read_config(self) -> BoardConfig:
        """Read all groups; what the board does not have reads as zeros."""
        return BoardConfig(
            limits=self._ask(m.GetLimits(), m.LimitsReply).limits,
            slew=self._ask(m.GetSlew(), m.SlewReply).slew,
            watchdog=self._ask(m.GetWatchdog(), m.WatchdogReply).watchdog,
            calibration=self._ask(m.GetCalibration(), m.CalibrationReply).calibration,
            acceleration=self._ask(m.GetAcceleration(), m.AccelerationReply).acceleration,
        )

    def configure(self, config: BoardConfig) -> None:
        """Set what differs, and read it back; disarms first if the board is armed.

        Raises:
            DeviceError: refused, or read back differently.
        """
        present = self.read_config()
        changes: list[m.Request] = []
        if present.limits != config.limits:
            changes.append(m.SetLimits(self._session, config.limits))
        if present.slew != config.slew:
            changes.append(m.SetSlew(self._session, config.slew))
        if present.watchdog != config.watchdog:
            changes.append(m.SetWatchdog(self._session, config.watchdog))
        if present.calibration != config.calibration:
            changes.append(m.SetCalibration(self._session, config.calibration))
        if present.acceleration != config.acceleration:
            changes.append(m.SetAcceleration(self._session, config.acceleration))
        if changes:
            if self.read_state().state in _MOVING_STATES:
                self.disarm()
            for change in changes:
                self._exchange.request(change)
            if self.read_config() != config:
                raise DeviceError(
                    "the board does not keep its configuration", "reset it; flash it again"
                )
        self._config = config

    def read_equipment(self) -> m.Equipment:
        """The board's name and what is wired to it."""
        return self._ask(m.GetEquipment(), m.EquipmentReply).equipment

    def require_name(self, wanted: str) -> None:
        """See that it is the board that is meant.

        Raises:
            WrongBoardError: it has another name; an empty one fits any board.
        """
        if wanted and (name := board_name(self.read_equipment())) != wanted:
            raise WrongBoardError(name, wanted)

    def set_equipment(self, equipment: m.Equipment) -> None:
        """Tell the board its name and what is wired to it; lost with a reset unless saved.

        Raises:
            RequestRefusedError: the board is armed or saving, or a value is out of range.
        """
        self._exchange.request(m.SetEquipment(self._session, equipment))

    def save_config(self) -> None:
        """Keep the configuration in EEPROM; returns when it is written."""
        self._exchange.request(m.SaveConfig(self._session))
        deadline_us = self._clock.now_us() + m.EEPROM_SLOT_SIZE * m.TICK_US + _MARGIN_US
        while True:
            self._clock.sleep_until_us(self._clock.now_us() + _STATE_POLL_US)
            report = self.read_state()
            if not report.flags & m.StatusFlags.EEPROM_BUSY:
                break
            if self._clock.now_us() > deadline_us:
                raise DeviceError("the board does not finish saving", "reset it and try again")
        if report.fault is m.Fault.EEPROM_FAILED:
            raise BoardFaultError(report.fault)

    def read_fault_log(self) -> list[m.FaultRecord]:
        """The last faults that the board has kept, the newest first; needs no session."""
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

    # Motion

    def arm(self) -> None:
        """Enable the servos and lead the robot to rest; returns when the board holds.

        Raises:
            BoardFaultError, BoardStoppedError: latched; nothing is cleared by itself.
            RequestRefusedError: the board is not configured.
        """
        report = self.read_state()
        _raise_if_latched(report)
        if report.state in _MOVING_STATES:
            self.disarm()
        self._may_move = True
        self._fed_us = self._fed_until_us = self._clock.now_us()
        self._exchange.request(m.Arm(self._session))
        config = self._config or self.read_config()
        axes_us = 2 * (config.watchdog.arm_axis_ms * 1000 + m.TICK_US)
        report = self._wait_for_state(
            State.HOLD, axes_us + _way_to_rest_us(config), on_the_way=(State.ARMING,)
        )
        self._targets.accepted_rad = cdeg_to_rad(report.setpoint_cdeg)
        self._heard_us = self._fed_us = self._clock.now_us()
        self._fed_until_us = self._fed_us + config.watchdog.relax_after_ms * 1000
        self._watching = True

    def set_target(
        self, q_rad: Sequence[float] | NDArray[np.float64], *, ramp_ms: int, validity_ms: int
    ) -> None:
        """Send a target and go on; the board clamps it, see `accepted_rad`.

        Raises:
            ValueError: not finite, or a time that the wire cannot carry.
            DeviceError: something has happened to the board since it was last looked at.
        """
        self.poll()
        first, second = (rad_to_cdeg(float(np.clip(angle, -np.pi, np.pi))) for angle in q_rad)
        target = m.SetTarget(self._session, (first, second), ramp_ms, validity_ms)
        if target.first_out_of_range() is not None:
            raise ValueError(f"ramp of {ramp_ms} ms or validity of {validity_ms} ms out of range")
        now_us = self._clock.now_us()
        if now_us > self._fed_until_us:
            self._gap_us, self._gap_end_us = now_us - self._fed_us, now_us
        self._fed_us, self._fed_until_us = now_us, now_us + validity_ms * 1000
        self._targets.sent(self._exchange.send(target), self._fed_us)
        if self._fed_us - self._synced_us >= _SYNC_PERIOD_US:
            self._synced_us = self._fed_us
            self._exchange.send(m.ClockSync(self._synced_us % _U32))

    def disarm(self) -> None:
        """Lead the robot to rest and take the pulses away; returns when that is done.

        Raises:
            BoardFaultError, BoardStoppedError: latched meanwhile; there are no pulses either.
            DeviceError: the board does not get there, or what :meth:`poll` tells of it.
        """
        if self._watching:
            self.poll()
        self._watching = False
        self._exchange.request(m.Disarm(self._session))
        bound_us = (
            _way_to_rest_us(self._config) if self._config else m.WAY_TO_REST_MS * 1000 + _MARGIN_US
        )
        self._wait_for_state(State.DISARMED, bound_us, on_the_way=(State.DISARMING,))
        self._may_move = False

    def stop(self) -> None:
        """Emergency stop: needs neither a session nor the right spec."""
        self._watching = False
        self._exchange.end_unfinished_frame()
        self._exchange.request(m.Stop(), attempts=_STOP_ATTEMPTS)
        self._may_move = False

    def clear_fault(self) -> None:
        """Acknowledge a fault or a stop; the board is disarmed then.

        A board that has latched a moment ago is given the ticks it needs to take the pulses away.
        """
        deadline_us = self._clock.now_us() + _MARGIN_US
        self._while_refused(m.ClearFault(self._session), (m.NackCode.BUSY, 0), m.Ack, deadline_us)

    # Observation

    def poll(self) -> None:
        """Take in what has arrived.

        Raises:
            LinkLossError: the board leads the robot to rest, or has done so.
            DeviceError: the board has latched a fault, was stopped or reset, obeys another host,
                or has fallen silent. All of them only between :meth:`arm` and :meth:`disarm`.
        """
        now_us = self._clock.now_us()
        self._exchange.poll(now_us)
        if self._watching:
            if now_us > self._fed_until_us:
                # After a stall the reports that wait in the port tell of the past.
                self.read_state()
            self._raise_troubles(now_us)

    def advance_to(self, time_us: int) -> None:
        """Take in what has arrived, on behalf of the clock; of all troubles only a latch is raised.

        Raises:
            BoardFaultError, BoardStoppedError, LinkLossError: as in :meth:`poll`.
        """
        if self._closed:
            return
        self._exchange.poll(time_us)
        if self._watching and self._newest and not self._exchange.waiting:
            report = self._newest.report
            if report.state in _LATCHED_STATES:
                self._raise_if_led_to_rest(report, time_us)
                _raise_if_latched(report)

    @property
    def next_turn_us(self) -> int:
        """When to look in spite of a silent line, which alone knows when bytes arrive.

        In every slice while an answer to a target is awaited, as that tells the round trip, and
        once the board has latched, which may have to be raised yet.
        """
        latched = self._watching and self._newest and self._newest.report.state in _LATCHED_STATES
        return 0 if latched or self._targets.awaits_answer else NEVER_US

    def read_state(self) -> m.StateReport:
        """Ask for the state; needs no session."""
        report = self._ask(m.GetState(), m.StateReply).report
        self._keep(report, self._clock.now_us())
        return report

    def read_counters(self) -> m.CountersReply:
        """Ask for what the board has counted since its reset; needs no session."""
        return self._ask(m.GetCounters(), m.CountersReply)

    @property
    def telemetry(self) -> ReceivedReport | None:
        """Newest report, from the stream or asked for."""
        return self._newest

    def telemetry_age_us(self) -> int | None:
        """Time since the newest report was read."""
        return None if self._newest is None else self._clock.now_us() - self._newest.time_us

    @property
    def accepted_rad(self) -> NDArray[np.float64]:
        """Newest target as the board has accepted it, rad, shape (2,); after arming the rest pose.

        Raises:
            DeviceError: not armed yet.
        """
        if self._targets.accepted_rad is None:
            raise DeviceError("the board has accepted no target yet", "arm it first")
        return self._targets.accepted_rad

    @property
    def identity(self) -> m.HelloReply | None:
        """What the board says it is; None before :meth:`connect`."""
        return self._identity

    @property
    def statistics(self) -> LinkStatistics:
        """Figures of both ends; the board's are those of the last connect or leave."""
        overdue_us = self._clock.now_us() - ANSWER_TIMEOUT_US
        return self._counts.figures(self._targets.unanswered(sent_before_us=overdue_us))

    # Leaving

    def _leave(self) -> BaseException | None:
        self._watching = False
        self._counts.board = None
        try:
            interrupted = self._make_safe() if self._may_move else None
            if self._identity:
                self._say_goodbye()
        except DeviceError as error:
            return error
        finally:
            self._closed = True
            self._transport.close()
        return interrupted

    def _make_safe(self) -> KeyboardInterrupt | None:
        try:
            self._exchange.end_unfinished_frame()
            with interruptible_again():
                self.disarm()
        except RequestRefusedError as refusal:
            if refusal.code in (m.NackCode.BAD_SESSION, m.NackCode.BAD_STATE):
                return None  # another host answers for the robot now, or there are no pulses
            self.stop()
        except (BoardFaultError, BoardStoppedError):
            return None
        except DeviceError:
            self.stop()
        except KeyboardInterrupt as second:
            self.stop()
            return second
        return None

    def _say_goodbye(self) -> None:
        try:
            self._counts.board = self.read_counters()
            if self._telemetry_period_ticks:
                self._exchange.request(m.SetTelemetry(self._session, 0))
        except (RequestRefusedError, BoardSilentError):
            return  # the robot is safe; all that is lost is the last count

    # Details

    def _hello(self) -> m.HelloReply:
        hello = m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH)
        return self._ask(hello, m.HelloReply, attempts=BOOT_TIMEOUT_US // ANSWER_TIMEOUT_US)

    def _open_session(self, deadline_us: int) -> m.SessionReply:
        request = m.OpenSession(m.SPEC_HASH, self._session)
        booting = (m.NackCode.BAD_STATE, State.BOOT)
        return self._while_refused(request, booting, m.SessionReply, deadline_us)

    def _while_refused(
        self, request: m.Request, for_now: tuple[m.NackCode, int], reply: type[R], deadline_us: int
    ) -> R:
        """Ask once a tick as long as the answer is the refusal that passes by itself."""
        while True:
            try:
                return self._ask(request, reply)
            except RequestRefusedError as refusal:
                if (refusal.code, refusal.detail) != for_now or self._clock.now_us() > deadline_us:
                    raise
                self._clock.sleep_until_us(self._clock.now_us() + _STATE_POLL_US)

    def _ask(self, request: m.Request, reply: type[R], attempts: int = ATTEMPTS) -> R:
        message = self._exchange.request(request, attempts)
        assert isinstance(message, reply), "each request has one kind of reply"
        return message

    def _wait_for_state(
        self, wanted: State, bound_us: int, on_the_way: tuple[State, ...]
    ) -> m.StateReport:
        deadline_us = self._clock.now_us() + bound_us
        while True:
            report = self.read_state()
            if report.state is wanted:
                return report
            self._raise_if_led_to_rest(report, self._clock.now_us())
            _raise_if_latched(report)
            if report.state not in on_the_way or self._clock.now_us() > deadline_us:
                raise WrongStateError(wanted, report.state)
            self._clock.sleep_until_us(self._clock.now_us() + _STATE_POLL_US)

    def _take(self, received: Received) -> None:
        match received.message:
            case m.Telemetry(report):
                self._count_lost_telemetry(received.sequence)
                self._keep(report, received.time_us)
                if self._on_telemetry:
                    self._on_telemetry(report, received.time_us)
            case m.TargetReply() as reply:
                self._counts.clamped_targets += m.StatusFlags.CLAMPED in reply.flags
                sent_us = self._targets.answered(received.sequence, reply)
                if sent_us is not None:
                    self._exchange.note_round_trip(sent_us, received.time_us)
            case m.Nack(request=m.SetTarget.ID) as nack:
                self._targets.refused(received.sequence, nack)
            case m.ClockReply() as reply:
                trip_us = (received.time_us - reply.host_time_us) % _U32
                sent_us = received.time_us - trip_us
                self.board_clock.add(sent_us, received.time_us, reply.board_time_us)

    def _keep(self, report: m.StateReport, time_us: int) -> None:
        self._newest = ReceivedReport(report, time_us)
        self._heard_us = time_us

    def _count_lost_telemetry(self, sequence: int) -> None:
        if self._telemetry_sequence is not None:
            self._counts.lost_telemetry += (sequence - self._telemetry_sequence - 1) % _U8
        self._telemetry_sequence = sequence

    def _raise_troubles(self, now_us: int) -> None:
        if self._newest is not None:
            self._raise_if_led_to_rest(self._newest.report, now_us)
            _raise_if_latched(self._newest.report)
        refusal = self._targets.take_refusal()
        if refusal is not None:
            self._diagnose(now_us)
            raise RequestRefusedError(m.SetTarget, refusal.code, refusal.detail)
        silent_us = now_us - self._heard_us
        if self._telemetry_period_ticks and silent_us > self._telemetry_timeout_us():
            self._diagnose(now_us)

    def _telemetry_timeout_us(self) -> int:
        return max(TELEMETRY_TIMEOUT_US, 5 * self._telemetry_period_ticks * m.TICK_US)

    def _diagnose(self, now_us: int) -> None:
        """Find out why the board does not go along; return if all is well after all."""
        identity = self._hello()
        if self._identity and identity.boot_id != self._identity.boot_id:
            self._counts.board_at_start = None
            raise BoardResetError(identity.reset_cause)
        try:
            self.start_telemetry(self._telemetry_period_ticks)
        except RequestRefusedError as refusal:
            if refusal.code is m.NackCode.BAD_SESSION:
                raise SessionTakenError from None
            raise
        report = self.read_state()
        self._raise_if_led_to_rest(report, now_us)
        _raise_if_latched(report)

    def _raise_if_led_to_rest(self, report: m.StateReport, now_us: int) -> None:
        latched = report.state is State.FAULT and report.fault is m.Fault.LINK_LOSS
        if latched or report.state is State.RELAXING:
            stalled, unfed_us = now_us > self._fed_until_us, now_us - self._fed_us
            if not stalled and now_us - self._gap_end_us < _LED_TO_REST_US:
                stalled, unfed_us = True, self._gap_us  # This target came too late.
            raise LinkLossError(unfed_us, host_stalled=stalled, latched=latched)


def _raise_if_latched(report: m.StateReport) -> None:
    if report.state is State.FAULT:
        raise BoardFaultError(report.fault)
    if report.state is State.STOPPED:
        raise BoardStoppedError


def _way_to_rest_us(config: BoardConfig) -> int:
    """Bound of the way from any pose to rest."""
    longest_ticks = 0
    for axis in (0, 1):
        range_cdeg = config.limits.angle_max_cdeg[axis] - config.limits.angle_min_cdeg[axis]
        slew = min(config.watchdog.relax_slew_cdeg_tick, config.slew.slew_cdeg_tick[axis])
        ticks = range_cdeg // max(slew, 1) + 1
        acceleration = config.acceleration.acceleration_cdeg_tick2[axis]
        if acceleration:  # to speed up, and before that to brake from whatever step fits the range
            ticks += slew // acceleration + isqrt(2 * range_cdeg // acceleration) + 4
        longest_ticks = max(longest_ticks, ticks)
    return longest_ticks * m.TICK_US + _MARGIN_US
