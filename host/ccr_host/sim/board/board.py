"""The emulated UNO and its line: bytes in, bytes and servo pulses out, on one clock in us."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from ccr_host.core.wire import bytes_in, wire_time_us
from ccr_host.link.framing import FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import (
    BAUD,
    FRAME_DELIMITER,
    LISTENS_AFTER_US,
    MAX_PAYLOAD,
    OUTSTANDING_BYTES,
    SEND_BYTES,
    SPEC_HASH,
    TICK_PHASE_US,
    TICK_US,
    Ack,
    Fault,
    LinkLimitsReply,
    ResetCause,
    State,
    StateReport,
    Stop,
    Telemetry,
)
from ccr_host.sim.board.core import BoardCore, Inputs
from ccr_host.sim.board.dispatch import Dispatcher
from ccr_host.sim.board.eeprom import EepromImage
from ccr_host.sim.board.setpoint import Axes


@dataclass(slots=True)
class _Sending:
    start_us: int
    data: bytes
    taken: int = 0


class SendBuffer:
    """Frames that are being sent.

    At most ``room`` bytes may wait.
    """

    def __init__(self, baud: int, room: int) -> None:
        self._baud = baud
        self._room = room
        self._frames: deque[_Sending] = deque()
        self._free_us = 0

    def offer(self, frame: bytes, now_us: int, spare_bytes: int) -> bool:
        """Queue a frame; False if it does not fit, or would leave less than `spare_bytes`."""
        start_us = max(now_us, self._free_us)
        waiting = bytes_in(start_us - now_us, self._baud)
        if waiting + len(frame) + spare_bytes > self._room:
            return False
        self._frames.append(_Sending(start_us, frame))
        self._free_us = start_us + wire_time_us(len(frame), self._baud)
        return True

    def take(self, now_us: int) -> bytes:
        """Remove and return the bytes whose last bit has been sent by now."""
        taken = bytearray()
        while self._frames and self._frames[0].start_us < now_us:
            head = self._frames[0]
            sent = min(bytes_in(now_us - head.start_us, self._baud), len(head.data))
            taken += head.data[head.taken : sent]
            head.taken = sent
            if sent < len(head.data):
                break
            self._frames.popleft()
        return bytes(taken)

    def frame_done_us(self) -> int | None:
        """Time at which the first queued frame is completely sent; None if there is none."""
        if not self._frames:
            return None
        head = self._frames[0]
        return head.start_us + wire_time_us(len(head.data), self._baud)


_START_UP_US = 9_000
"""Time for which the board reads its EEPROM; received bytes wait until then."""
_STOP_ANSWER_BYTES = len(encode_frame(Ack.ID, 0, bytes(Ack.SIZE)))
_U32 = 1 << 32


class UnoEmulator:
    """The whole board; acts only in :meth:`advance_to` and :meth:`receive`.

    Args:
        eeprom: kept across resets; erased memory if omitted.
        reset_cause: cause of the first start.
        start_us: time of the first start on the caller's clock.
        baud: bit rate of the answers.
        spec_hash: hash of the spec that the board claims to be built from.
        board_time_at_reset_us: value of its 32-bit clock at a reset, to test wrapping.
        tick_offset: value of its tick counter at a reset, to test wrapping.
        axes: number of servos; that of an UNO by default.
        link_limits: what a host may have outstanding; None for the limits of the spec.
    """

    def __init__(
        self,
        eeprom: EepromImage | None = None,
        *,
        reset_cause: ResetCause = ResetCause.POWER_ON,
        start_us: int = 0,
        baud: int = BAUD,
        spec_hash: int = SPEC_HASH,
        board_time_at_reset_us: int = 0,
        tick_offset: int = 0,
        axes: int = 2,
        link_limits: LinkLimitsReply | None = None,
    ) -> None:
        self.axes = axes
        self._eeprom = eeprom if eeprom is not None else EepromImage()
        self._baud = baud
        self._spec_hash = spec_hash
        self._link_limits = link_limits
        self._board_time_at_reset_us = board_time_at_reset_us
        self._tick_offset = tick_offset
        self._now_us = start_us
        self._pulses_prepared: Axes = (0,) * axes
        self.inputs = Inputs()
        self.reset(reset_cause)

    def reset(self, cause: ResetCause, boot_loader_us: int = 0) -> None:
        """Restart `boot_loader_us` from now; bytes received before the board listens are lost."""
        self._start_us = self._now_us + boot_loader_us
        had_pulses = any(self._pulses_prepared)
        self._core = BoardCore(
            self._eeprom, cause, had_pulses, self._tick_offset, self.inputs, self.axes
        )
        self._dispatcher = Dispatcher(
            self._core, self.board_time_us, self._spec_hash, self._link_limits
        )
        self._decoder = FrameDecoder(MAX_PAYLOAD.of(self.axes))
        self._received_early = bytearray()
        self._sending = SendBuffer(self._baud, SEND_BYTES.of(self.axes))
        self._next_tick_us = self._start_us + TICK_PHASE_US
        self._pulses_on_pins: Axes = (0,) * self.axes
        self._pulses_prepared = self._pulses_on_pins
        self._latch_us = self._start_us

    def advance_to(self, time_us: int) -> None:
        """Run all control ticks up to and including `time_us`."""
        started_us = self._start_us + _START_UP_US
        if self._received_early and time_us >= started_us:
            self._now_us = max(started_us, self._now_us)
            self._take(bytes(self._received_early))
            self._received_early.clear()
        while self._next_tick_us <= time_us:
            self._now_us = self._next_tick_us
            self._next_tick_us += TICK_US
            self._run_tick()
        self._now_us = max(time_us, self._now_us)

    def receive(self, data: bytes) -> None:
        """Receive bytes that arrive now, and dispatch the requests that they complete.

        During start-up bytes are buffered, as many as a host may have outstanding.
        """
        since_start_us = self._now_us - self._start_us
        if since_start_us < LISTENS_AFTER_US:
            return
        if since_start_us < _START_UP_US:
            room = OUTSTANDING_BYTES.of(self.axes) - len(self._received_early)
            self._received_early += data[:room]
            self._core.counters.count("overruns", len(data[room:]))
            return
        self._take(data)

    def _take(self, data: bytes) -> None:
        for item in self._decoder.feed(data):
            if isinstance(item, FramingError):
                self._core.counters.count(item.value)
                continue
            self._core.counters.count("frames_accepted")
            answer = self._dispatcher.answer(item)
            self._send(answer, 0 if item.id == Stop.ID else _STOP_ANSWER_BYTES)

    def take_output(self) -> bytes:
        """Remove and return the bytes that the board has sent by now."""
        return self._sending.take(self._now_us)

    def inject_fault(self, fault: Fault) -> None:
        """Make the board detect a fault now."""
        self._core.safety.raise_fault(fault)

    @property
    def pulses_half_us(self) -> Axes:
        """Pulses on the pins in the current frame, in 0.5 us; 0 is no pulse."""
        latched = self._now_us >= self._latch_us
        return self._pulses_prepared if latched else self._pulses_on_pins

    def open_emergency_stop(self, is_open: bool = True) -> None:
        """Open or close the switch between the input and ground; initially closed."""
        self.inputs.emergency_stop_open = is_open

    def set_supply_pin_mv(self, voltage_mv: int) -> None:
        """Set the output of the servo supply's divider; initially 3000."""
        self.inputs.supply_pin_mv = voltage_mv

    @property
    def servo_supply_on(self) -> bool:
        return self._core.servo_supply_on

    @property
    def led_on(self) -> bool:
        return self._core.led_on

    @property
    def state(self) -> State:
        return self._core.state

    def report(self) -> StateReport:
        """The report that `get_state` would return now."""
        return self._core.report()

    @property
    def now_us(self) -> int:
        """Time to which the board has been advanced."""
        return self._now_us

    @property
    def next_frame_us(self) -> int:
        """Start of the next pulse frame, until which the pulses do not change."""
        since_start_us = self._now_us - self._start_us
        if since_start_us < 0:
            return self._start_us
        return self._start_us + (since_start_us // TICK_US + 1) * TICK_US

    @property
    def next_event_us(self) -> int:
        """Time of the next event if no byte arrives."""
        done_us = self._sending.frame_done_us()
        event_us = self._next_tick_us if done_us is None else min(done_us, self._next_tick_us)
        return min(self._start_us + _START_UP_US, event_us) if self._received_early else event_us

    def board_time_us(self) -> int:
        """The board's 32-bit clock."""
        return (self._now_us - self._start_us + self._board_time_at_reset_us) % _U32

    def _run_tick(self) -> None:
        core = self._core
        core.tick()
        self._pulses_on_pins = self._pulses_prepared
        self._pulses_prepared = core.pulses_half_us
        self._latch_us = self._now_us + TICK_US - TICK_PHASE_US
        sequence = core.session.telemetry.tick()
        if sequence is not None:
            report = encode_frame(Telemetry.ID, sequence, core.report().pack())
            self._send(report, _STOP_ANSWER_BYTES)

    def _send(self, frame: bytes, spare_bytes: int) -> None:
        if not self._sending.offer(frame, self._now_us, spare_bytes):
            self._core.counters.count("replies_dropped")


DISPATCH_LATENCY_US = 50
"""Time from the last bit of a request to its dispatch: one pass of the firmware's main loop."""


class SerialLine:
    """The line between host and board, with its transmission time; its host end is a transport.

    It advances the board and the bytes in order of time. Transmission starts when bytes are
    written. The board receives the bytes of a frame together when the last one has arrived; its
    decoder cannot tell the difference.
    """

    name = "emulator"

    def __init__(self, board: UnoEmulator) -> None:
        self.board = board
        self._to_board: deque[tuple[int, bytes]] = deque()
        self._wire_free_us = 0

    def advance_to(self, time_us: int) -> None:
        board = self.board
        while self._to_board and self._to_board[0][0] <= time_us:
            arrival_us, data = self._to_board.popleft()
            board.advance_to(arrival_us)
            board.receive(data)
        board.advance_to(time_us)

    @property
    def next_event_us(self) -> int:
        board_us = self.board.next_event_us
        return min(board_us, self._to_board[0][0]) if self._to_board else board_us

    def write(self, data: bytes) -> None:
        start_us = max(self.board.now_us, self._wire_free_us)
        begin = 0
        while begin < len(data):
            end = _end_of_frame(data, begin)
            arrival_us = start_us + wire_time_us(end, BAUD) + DISPATCH_LATENCY_US
            self._to_board.append((arrival_us, data[begin:end]))
            begin = end
        self._wire_free_us = start_us + wire_time_us(len(data), BAUD)

    def read(self) -> bytes:
        return self.board.take_output()

    def close(self) -> None:
        """Do nothing: the board keeps running, like an UNO on a power supply."""

    def open_port(self, boot_loader_us: int = 0) -> None:
        self._to_board.clear()
        self._wire_free_us = self.board.now_us
        self.board.reset(ResetCause.EXTERNAL, boot_loader_us)


def _end_of_frame(data: bytes, begin: int) -> int:
    zero = data.find(FRAME_DELIMITER, begin)
    return len(data) if zero < 0 else zero + 1
