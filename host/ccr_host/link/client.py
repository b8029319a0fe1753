"""The host's end of the link: one board, one session, always left in a safe state.

`Board` makes one request at a time, through an `Exchange` of requests and answers. The client moves
the robot, monitors it, and makes it safe.
"""

from __future__ import annotations

from types import TracebackType
from typing import Final, Self

from ccr_host.core.arrays import Array
from ccr_host.core.clock import NEVER_US, Clock
from ccr_host.core.errors import DeviceError
from ccr_host.core.stop_signals import interruptible_again
from ccr_host.core.wire import cdeg_to_rad
from ccr_host.link import messages as m
from ccr_host.link.board import STATE_POLL_US, Board, TelemetryObserver
from ccr_host.link.board_config import BoardConfig
from ccr_host.link.device_errors import (
    BoardFaultError,
    BoardResetError,
    BoardSilentError,
    BoardStoppedError,
    RequestRefusedError,
    SessionTakenError,
    WrongStateError,
)
from ccr_host.link.exchange import (
    ANSWER_TIMEOUT_US,
    FrameObserver,
    LinkStatistics,
    Received,
    Transport,
)
from ccr_host.link.messages import State
from ccr_host.link.targets import Angles, TargetLog, latched_error, on_wire

_SYNC_PERIOD_US = 10_000_000
_MARGIN_US = 1_000_000
_STOP_ATTEMPTS = 8
_U32 = 1 << 32

_MOVING_STATES: Final = frozenset(
    {State.ARMING, State.ACTIVE, State.HOLD, State.RELAXING, State.DISARMING}
)

_LATCHED_STATES: Final = frozenset({State.FAULT, State.STOPPED})
_LOST_STATES: Final = _LATCHED_STATES | {State.RELAXING}


class Client(Board):
    """Communicates with one board; used as a context manager.

    However the `with` block is left, the robot is made safe first: disarmed if the board
    cooperates, otherwise stopped. A second Ctrl-C stops it at once.

    It waits only through the clock. Attached to the clock, it also receives telemetry while another
    part of the program waits. ``session``, ``motors`` (None until it is configured) and
    ``on_frame`` are as for `Board`; ``on_telemetry`` is called with every streamed report. The
    transport is closed on leaving.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        session: int,
        *,
        motors: int | None = None,
        on_frame: FrameObserver | None = None,
        on_telemetry: TelemetryObserver | None = None,
    ) -> None:
        super().__init__(transport, clock, session, self._take, on_frame, motors)
        self._transport = transport
        self._on_telemetry = on_telemetry
        self._config: BoardConfig | None = None
        self._targets = TargetLog()
        self._may_move = False
        self._watching = False
        self._closed = False

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
        """Wait for the board, check its spec, open a session, start telemetry.

        Reading and :meth:`stop` still work after a :class:`SpecMismatchError`.

        Raises:
            BoardSilentError: no answer within `BOOT_TIMEOUT_US`.
            SpecMismatchError: board and host are built from different specs.
            DeviceError: the port is gone, or the board has fewer axes than the robot motors.
        """
        identity, state = self._open_session()
        self._may_move = state in _MOVING_STATES
        self._counts.board_at_start = self._counts.board = self.read_counters()
        self.sync_clock()
        if telemetry_period_ticks:
            self.start_telemetry(telemetry_period_ticks)
        return identity

    # Configuration

    def configure(self, config: BoardConfig) -> None:
        """Set the groups that differ and verify them; an armed board is disarmed first.

        Axes without a motor are configured as the last motor, and stay at its rest.

        Raises:
            DeviceError: the board has too few axes, refuses, or reads back differently.
        """
        self._motors = config.axes
        present = self.read_config()
        config = config.for_board(present.axes)
        if present != config:
            if self.read_state().state in _MOVING_STATES:
                self.disarm()
            self.set_config(present, config)
        self._config = config

    # Motion

    def arm(self) -> None:
        """Enable the servos and lead the robot to rest; returns when the board holds.

        Raises:
            BoardFaultError, BoardStoppedError: latched, which only `clear_fault` ends.
            RequestRefusedError: the board is not configured.
        """
        report = self.read_state()
        if report.state in _LATCHED_STATES:
            raise latched_error(report)
        if report.state in _MOVING_STATES:
            self.disarm()
        self._may_move = True
        self._targets.fed_us = self._targets.fed_until_us = self._clock.now_us()
        self._exchange.request(m.Arm(self._session))
        config = self._config or self.read_config()
        axes_us = config.axes * (config.watchdog.arm_axis_ms * 1000 + m.TICK_US)
        report = self._wait_for_state(
            State.HOLD, axes_us + config.way_to_rest_us(), on_the_way=(State.ARMING,)
        )
        self._targets.accepted_rad = cdeg_to_rad(report.setpoint_cdeg)
        self._heard_us = self._targets.fed_us = self._clock.now_us()
        self._targets.fed_until_us = self._heard_us + config.watchdog.relax_after_ms * 1000
        self._watching = True

    def set_target(self, q_rad: Angles, *, ramp_ms: int, validity_ms: int) -> None:
        """Send a target without waiting; the board clamps it, see `accepted_rad`.

        Raises:
            ValueError: not finite, or a time that the wire cannot carry.
            DeviceError: as in :meth:`poll`.
        """
        self.poll()
        target = on_wire(self._session, q_rad, ramp_ms, validity_ms, self._config)
        sequence, now_us = self._exchange.send(target)
        self._targets.feed(now_us, now_us + validity_ms * 1000, unanswered=sequence)
        if now_us - self._synced_us >= _SYNC_PERIOD_US:
            self._exchange.wait_for_room(m.ClockSync.SIZE)
            self._synced_us = self._clock.now_us()
            self._exchange.send(m.ClockSync(self._synced_us % _U32))

    def set_target_at(self, tick: int, q_rad: Angles, *, ramp_ms: int, validity_ms: int) -> None:
        """Send a target that takes effect at a control tick, numbered as in the board's reports.

        The board keeps the newest one. Returns when it has acknowledged it; there is no retry.

        Raises:
            ValueError, DeviceError: as in :meth:`set_target`; also if the tick is not ahead, or the
                board's firmware older than this request.
        """
        self.poll()
        self.require(m.SetTargetAt)
        now = on_wire(self._session, q_rad, ramp_ms, validity_ms, self._config)
        target = m.SetTargetAt(
            now.session, now.target_cdeg, now.ramp_ms, now.validity_ms, tick % _U32
        )
        lead_us = (tick - self.read_state().tick) % _U32 * m.TICK_US
        self._exchange.request(target, attempts=1)
        now_us = self._clock.now_us()
        self._targets.feed(now_us, now_us + lead_us + validity_ms * 1000)

    def disarm(self) -> None:
        """Lead the robot to rest and end the pulses; returns when that is done.

        Raises:
            BoardFaultError, BoardStoppedError: latched meanwhile; there are no pulses either.
            DeviceError: the board does not get there, or as in :meth:`poll`.
        """
        if self._watching:
            self.poll()
        self._watching = False
        self._exchange.request(m.Disarm(self._session))
        bound_us = (
            self._config.way_to_rest_us() if self._config else m.WAY_TO_REST_MS * 1000 + _MARGIN_US
        )
        self._wait_for_state(State.DISARMED, bound_us, on_the_way=(State.DISARMING,))
        self._may_move = False

    def stop(self) -> None:
        """Emergency stop: needs neither a session nor the right spec."""
        self._watching = False
        self._exchange.end_unfinished_frame()
        self._exchange.request(m.Stop(), attempts=_STOP_ATTEMPTS)
        self._may_move = False

    # Observation

    def poll(self) -> None:
        """Process what has arrived.

        Raises:
            LinkLossError: the board leads the robot to rest, or has done so.
            DeviceError: the board has latched a fault, was stopped or reset, obeys another host,
                or has fallen silent; all of these only between :meth:`arm` and :meth:`disarm`.
        """
        now_us = self._clock.now_us()
        self._exchange.poll(now_us)
        if not self._watching:
            return
        if now_us > self._targets.fed_until_us:
            # After a stall, the reports waiting in the port are out of date.
            self.read_state()
        if self._newest is not None and self._newest.report.state in _LOST_STATES:
            raise self._targets.loss(self._newest.report, now_us)
        if (refusal := self._targets.refusal) is not None:
            self._targets.refusal = None
            self._diagnose(now_us)
            raise RequestRefusedError(m.SetTarget, refusal.code, refusal.detail)
        silent_us = now_us - self._heard_us
        if self._telemetry_period_ticks and silent_us > self._silence_us:
            self._diagnose(now_us)

    def advance_to(self, time_us: int) -> None:
        """Process what has arrived, called by the clock; raises only if the board has latched.

        Raises:
            BoardFaultError, BoardStoppedError, LinkLossError: as in :meth:`poll`.
        """
        if self._closed:
            return
        self._exchange.poll(time_us)
        if self._watching and self._newest and not self._exchange.waiting:
            report = self._newest.report
            if report.state in _LATCHED_STATES:
                raise self._targets.loss(report, time_us)

    @property
    def next_turn_us(self) -> int:
        """Time at which to poll even if the line announces no bytes.

        That is in every slice while an answer to a target is pending, since it gives the round
        trip, and once the board has latched, which may still have to be raised.
        """
        latched = self._watching and self._newest and self._newest.report.state in _LATCHED_STATES
        return 0 if latched or self._targets.awaits_answer else NEVER_US

    @property
    def accepted_rad(self) -> Array:
        """Newest target as the board has accepted it, rad, (motors,); at first the rest pose.

        Raises:
            DeviceError: not armed yet.
        """
        if self._targets.accepted_rad is None:
            raise DeviceError("the board has accepted no target yet", "arm it first")
        return self._targets.accepted_rad[: self._motors]

    @property
    def statistics(self) -> LinkStatistics:
        """Statistics of both ends; the board's are those of the last connect or leave."""
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
                return None  # another host is responsible for the robot now, or there are no pulses
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
            return  # the robot is safe; only the last counters are lost

    # Details

    def _wait_for_state(
        self, wanted: State, bound_us: int, on_the_way: tuple[State, ...]
    ) -> m.StateReport:
        deadline_us = self._clock.now_us() + bound_us
        while True:
            report = self.read_state()
            if report.state is wanted:
                return report
            if report.state in _LOST_STATES:
                raise self._targets.loss(report, self._clock.now_us())
            if report.state not in on_the_way or self._clock.now_us() > deadline_us:
                raise WrongStateError(wanted, report.state)
            self._clock.sleep_until_us(self._clock.now_us() + STATE_POLL_US)

    def _take(self, received: Received) -> None:
        match received.message:
            case m.Telemetry(report):
                self._count_lost_telemetry(received.sequence)
                report = self._keep(report, received.time_us)
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

    def _diagnose(self, now_us: int) -> None:
        """Find out why the board does not cooperate; return if nothing is wrong."""
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
        if report.state in _LOST_STATES:
            raise self._targets.loss(report, now_us)
