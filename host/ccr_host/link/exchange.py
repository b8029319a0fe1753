"""Requests and their answers: sequence numbers, retries, round trips, statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.clock import Clock
from ccr_host.core.units import cdeg_to_rad
from ccr_host.link.device_errors import BoardSilentError, RequestRefusedError
from ccr_host.link.framing import Frame, FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import (
    FRAME_DELIMITER,
    MESSAGES,
    RETRY_WINDOW_TICKS,
    TICK_US,
    Ack,
    CountersReply,
    Message,
    Nack,
    PayloadError,
    Request,
    TargetReply,
)

ANSWER_TIMEOUT_US = 100_000
"""Ten times the slowest answer seen through a USB serial adapter (16 ms latency timer)."""
ATTEMPTS = 8
POLL_STEP_US = 200
"""Five bytes at 250000 baud: the resolution of the round-trip times."""
_COARSE_POLL_US = 2000
"""A round trip read by a host that looked away for longer says nothing about the link."""
_U8 = 1 << 8
_U16 = 1 << 16

assert ATTEMPTS * ANSWER_TIMEOUT_US < RETRY_WINDOW_TICKS * TICK_US, "a late retry would run twice"

FrameObserver = Callable[[str, int, bytes], None]
"""Direction ("sent" or "received"), host time in us, the bytes of one frame."""


class Transport(Protocol):
    """A byte stream; `DeviceError` from any method means that the port is lost."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Bytes that have arrived; empty if none have, never waits."""

    def close(self) -> None:
        """Let go of the port."""


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Figures of one connection; errors and retries from its first hello on."""

    sent: int
    """Frames, repetitions included."""
    received: int
    """Whole frames."""
    crc_errors: int
    """Frames damaged on the way, on both ends, whether CRC, encoding or size has told."""
    retries: int
    rtt_us_median: float | None
    """From the first byte sent to the answer read; only where nothing was repeated."""
    rtt_us_p99: float | None
    unanswered_targets: int
    lost_telemetry: int
    clamped_targets: int
    """Outside the angle limits, so that the board has accepted others instead."""
    holds: int | None
    """How often the board held the pose for want of a fresh target; None if it was not asked."""
    relaxes: int | None
    """How often it began to lead the robot to rest, likewise."""


@dataclass
class LinkCounts:
    """Counts as they grow; :meth:`figures` sums them up."""

    sent: int = 0
    received: int = 0
    retries: int = 0
    lost_telemetry: int = 0
    clamped_targets: int = 0
    unusable: int = 0
    """Whole frames that are no message this host knows."""
    framing_errors: Counter[FramingError] = field(default_factory=Counter)
    round_trips_us: list[int] = field(default_factory=list)
    board_at_start: CountersReply | None = None
    board: CountersReply | None = None
    """As last read; None once that has failed."""

    def forget_waiting_for_the_board(self) -> None:
        """Start again once the board has answered its first hello.

        Until then a boot loader was deaf, and half a frame is no error of the line.
        """
        self.framing_errors.clear()
        self.retries = 0

    def figures(self, unanswered_targets: int) -> LinkStatistics:
        """The statistics so far."""
        median, p99 = _median_and_p99(self.round_trips_us)
        return LinkStatistics(
            sent=self.sent,
            received=self.received,
            crc_errors=self.framing_errors.total() + self._board_framing_errors(),
            retries=self.retries,
            rtt_us_median=median,
            rtt_us_p99=p99,
            unanswered_targets=unanswered_targets,
            lost_telemetry=self.lost_telemetry,
            clamped_targets=self.clamped_targets,
            holds=self._counted_by_the_board("holds"),
            relaxes=self._counted_by_the_board("relaxes"),
        )

    def _board_framing_errors(self) -> int:
        return sum(self._counted_by_the_board(error.value) or 0 for error in FramingError)

    def _counted_by_the_board(self, name: str) -> int | None:
        """On this connection, of a counter of 16 bits."""
        if self.board is None or self.board_at_start is None:
            return None
        before: int = getattr(self.board_at_start, name)
        now: int = getattr(self.board, name)
        return (now - before) % _U16


def _median_and_p99(values: list[int]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    median, p99 = np.quantile(values, [0.5, 0.99])
    return float(median), float(p99)


@dataclass(frozen=True, slots=True)
class Received:
    """One message from the board."""

    message: Message
    sequence: int
    time_us: int


@dataclass(slots=True)
class _Awaited:
    request: Request
    sequence: int
    answer: Received | None = None

    def matches(self, message: Message, sequence: int) -> bool:
        if sequence != self.sequence:
            return False
        if isinstance(message, Ack | Nack) and message.request != self.request.ID:
            return False
        return isinstance(message, Nack) or message.ID == self.request.REPLY_ID


class Exchange:
    """One request at a time; whatever else the board says goes to `on_message`."""

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        counts: LinkCounts,
        on_message: Callable[[Received], None],
        on_frame: FrameObserver | None,
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._counts = counts
        self._on_message = on_message
        self._on_frame = on_frame
        self._decoder = FrameDecoder()
        self._next_sequence = 0
        self._awaited: _Awaited | None = None
        self._polled_us = clock.now_us()

    @property
    def waiting(self) -> bool:
        """Whether a request waits for its answer."""
        return self._awaited is not None

    def end_unfinished_frame(self) -> None:
        """Close whatever an interrupted write has left on the wire."""
        self._transport.write(bytes([FRAME_DELIMITER]))

    def send(self, request: Request, now_us: int) -> int:
        """Send without waiting; gives the sequence number."""
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % _U8
        self._write(encode_frame(request.ID, sequence, request.pack()), now_us)
        return sequence

    def request(self, request: Request, attempts: int = ATTEMPTS) -> Message:
        """Send, wait for the answer, repeat with the same sequence number where none comes.

        Raises:
            BoardSilentError: no answer to any attempt.
            RequestRefusedError: the board answered `nack`.
            DeviceError: the port is gone.
        """
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % _U8
        frame = encode_frame(request.ID, sequence, request.pack())
        awaited = self._awaited = _Awaited(request, sequence)
        try:
            for attempt in range(attempts):
                sent_us = self._clock.now_us()
                if attempt > 0:
                    self._counts.retries += 1
                self._write(frame, sent_us)
                answer = self._wait_for_answer(awaited, sent_us + ANSWER_TIMEOUT_US)
                if answer is not None:
                    if attempt == 0:
                        self._counts.round_trips_us.append(answer.time_us - sent_us)
                    return _accepted(request, answer.message)
        finally:
            self._awaited = None
        heard_before = self._counts.received > 0
        raise BoardSilentError(self._transport.name, request.NAME, heard_before=heard_before)

    def poll(self, now_us: int) -> None:
        """Take in what has arrived."""
        data = self._transport.read()
        for item in self._decoder.feed(data) if data else ():
            if isinstance(item, FramingError):
                self._counts.framing_errors[item] += 1
            else:
                self._take(item, now_us)
        self._polled_us = now_us

    def note_round_trip(self, sent_us: int, received_us: int) -> None:
        """Count a round trip that was awaited elsewhere, if it was looked for often enough."""
        if received_us - self._polled_us <= _COARSE_POLL_US:
            self._counts.round_trips_us.append(received_us - sent_us)

    def _wait_for_answer(self, awaited: _Awaited, deadline_us: int) -> Received | None:
        clock = self._clock
        while True:
            self.poll(clock.now_us())
            if awaited.answer is not None:
                return awaited.answer
            now_us = clock.now_us()
            if now_us >= deadline_us:
                return None
            clock.sleep_until_us(min(now_us + POLL_STEP_US, deadline_us))

    def _write(self, frame: bytes, now_us: int) -> None:
        self._counts.sent += 1
        if self._on_frame:
            self._on_frame("sent", now_us, frame)
        self._transport.write(frame)

    def _take(self, frame: Frame, now_us: int) -> None:
        self._counts.received += 1
        if self._on_frame:
            self._on_frame(
                "received", now_us, encode_frame(frame.id, frame.sequence, frame.payload)
            )
        message = _parse(frame)
        if message is None:
            self._counts.unusable += 1
            return
        received = Received(message, frame.sequence, now_us)
        if self._awaited and self._awaited.matches(message, frame.sequence):
            self._awaited.answer = received
        else:
            self._on_message(received)


class TargetLog:
    """What became of the targets that were sent: never repeated, so some stay unanswered.

    By sequence number; bounded, as those wrap after 256.
    """

    def __init__(self) -> None:
        self.accepted_rad: NDArray[np.float64] | None = None
        """Newest target as the board has accepted it, shape (2,)."""
        self._open_since_us: dict[int, int] = {}
        self._given_up = 0
        self.refusal: Nack | None = None
        """The newest, until somebody has acted upon it."""

    def sent(self, sequence: int, time_us: int) -> None:
        """Wait for an answer to a new target."""
        self._given_up += sequence in self._open_since_us
        self._open_since_us[sequence] = time_us

    @property
    def awaits_answer(self) -> bool:
        """Whether a target is unanswered."""
        return bool(self._open_since_us)

    def answered(self, sequence: int, reply: TargetReply) -> int | None:
        """Take an answer; gives the time at which its target was sent."""
        sent_us = self._open_since_us.pop(sequence, None)
        if sent_us is not None:
            self.accepted_rad = cdeg_to_rad(reply.target_cdeg)
        return sent_us

    def refused(self, sequence: int, refusal: Nack) -> None:
        """Keep a refusal until somebody acts upon it."""
        self._open_since_us.pop(sequence, None)
        self.refusal = refusal

    def unanswered(self, sent_before_us: int) -> int:
        """How many targets sent before a time have got no answer."""
        overdue = sum(sent_us < sent_before_us for sent_us in self._open_since_us.values())
        return self._given_up + overdue


def _parse(frame: Frame) -> Message | None:
    kind = MESSAGES.get(frame.id)
    if kind is None:
        return None
    try:
        return kind.unpack(frame.payload)
    except PayloadError:
        return None


def _accepted(request: Request, answer: Message) -> Message:
    if isinstance(answer, Nack):
        raise RequestRefusedError(type(request), answer.code, answer.detail)
    return answer
