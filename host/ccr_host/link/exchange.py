"""Requests and their answers: sequence numbers, retries, round trips, statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import cycle
from typing import Protocol

import numpy as np

from ccr_host.core.clock import Clock
from ccr_host.link.device_errors import BoardSilentError, RequestRefusedError
from ccr_host.link.framing import Frame, FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import (
    FRAME_DELIMITER,
    FRAME_OVERHEAD,
    MESSAGES,
    RETRY_WINDOW_TICKS,
    TICK_US,
    Ack,
    CountersReply,
    LinkLimitsReply,
    Message,
    Nack,
    PayloadError,
    Request,
    Stop,
    Telemetry,
)

ANSWER_TIMEOUT_US = 100_000
"""Ten times the slowest answer measured through a USB serial adapter (16 ms latency timer)."""
ATTEMPTS = 8
POLL_STEP_US = 200
"""Duration of five bytes at 250000 baud: the resolution of the round-trip times."""
_COARSE_POLL_US = 2000
"""If the host polled less often than this, a round trip says nothing about the link."""
_ENCODING_BYTES = FRAME_OVERHEAD + 2
"""What a frame on the wire has besides its payload: also a code byte of COBS and the zero."""
_U16 = 1 << 16

_FOREIGN_BYTES = 30
"""How much of what another server sends is shown to the user."""

assert ATTEMPTS * ANSWER_TIMEOUT_US < RETRY_WINDOW_TICKS * TICK_US, "a late retry would run twice"

FrameObserver = Callable[[str, int, bytes], None]
"""Called with direction ("sent" or "received"), host time in us, and the bytes of a frame."""


class Transport(Protocol):
    """A byte stream; `DeviceError` from any method means that the port is lost."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Return the bytes that have arrived, possibly none; never waits."""

    def close(self) -> None:
        """Close the port."""


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Statistics of a connection; errors and retries are counted from its first hello."""

    sent: int
    """Frames sent, including repetitions."""
    received: int
    """Complete frames received."""
    crc_errors: int
    """Frames received damaged by either end: wrong CRC, encoding or size."""
    retries: int
    rtt_us_median: float | None
    """Median time from the first byte sent to the answer, of requests that were not repeated."""
    rtt_us_p99: float | None
    unanswered_targets: int
    lost_telemetry: int
    clamped_targets: int
    """Targets that the board has clamped to the angle limits."""
    holds: int | None
    """How often the board held the pose for lack of a fresh target; None if it was not read."""
    relaxes: int | None
    """How often the board began to lead the robot to rest; None if it was not read."""


@dataclass
class LinkCounts:
    """The running counts of a connection, summarised by :meth:`figures`."""

    sent: int = 0
    received: int = 0
    retries: int = 0
    lost_telemetry: int = 0
    clamped_targets: int = 0
    framing_errors: Counter[FramingError] = field(default_factory=Counter)
    round_trips_us: list[int] = field(default_factory=list)
    board_at_start: CountersReply | None = None
    board: CountersReply | None = None
    """The board's counters as last read; None if that failed."""

    def forget_waiting_for_the_board(self) -> None:
        """Reset the error counts, once the board has answered its first hello.

        Until then a boot loader ignores requests, and half a frame is not an error of the line.
        """
        self.framing_errors.clear()
        self.retries = 0

    def figures(self, unanswered_targets: int) -> LinkStatistics:
        median, p99 = _median_and_p99(self.round_trips_us)
        return LinkStatistics(
            sent=self.sent,
            received=self.received,
            crc_errors=self.framing_errors.total()
            + sum(self._counted_by_the_board(error.value) or 0 for error in FramingError),
            retries=self.retries,
            rtt_us_median=median,
            rtt_us_p99=p99,
            unanswered_targets=unanswered_targets,
            lost_telemetry=self.lost_telemetry,
            clamped_targets=self.clamped_targets,
            holds=self._counted_by_the_board("holds"),
            relaxes=self._counted_by_the_board("relaxes"),
        )

    def _counted_by_the_board(self, name: str) -> int | None:
        """The increase of a 16-bit counter of the board during this connection."""
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
    """Makes one request at a time; any other message of the board goes to `on_message`.

    Requests that are sent without waiting for their replies are held back while as many are
    outstanding as the board accepts (REQ-5). A reply that is `ANSWER_TIMEOUT_US` late counts as
    lost. Only `stop` is never held back.
    """

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
        self._heard_board = False
        self._foreign = b""
        """The first bytes that arrived before any message of the board."""
        self._sequences = cycle(range(1 << 8))
        self._awaited: _Awaited | None = None
        self._polled_us = clock.now_us()
        self._outstanding: dict[int, tuple[int, int]] = {}
        """Bytes on the wire, and time of sending in us, of requests without a reply."""
        self.limits = LinkLimitsReply(outstanding_requests=1, outstanding_bytes=0)
        """What the board accepts; one request at a time until that is known."""

    @property
    def waiting(self) -> bool:
        """Whether a request is pending."""
        return self._awaited is not None

    def end_unfinished_frame(self) -> None:
        """Terminate a frame that an interrupted write may have left on the wire."""
        self._transport.write(bytes([FRAME_DELIMITER]))

    def wait_for_room(self, payload_bytes: int) -> None:
        """Wait until the board accepts one more request with so long a payload.

        Raises:
            DeviceError: the port is gone.
        """
        clock, limits = self._clock, self.limits
        while self._outstanding:
            now_us = clock.now_us()
            self._outstanding = {
                sequence: (wire_bytes, sent_us)
                for sequence, (wire_bytes, sent_us) in self._outstanding.items()
                if now_us - sent_us < ANSWER_TIMEOUT_US
            }
            waiting = [wire_bytes for wire_bytes, _ in self._outstanding.values()]
            total_bytes = sum(waiting) + payload_bytes + _ENCODING_BYTES
            fits = len(waiting) < limits.outstanding_requests
            if not waiting or (fits and total_bytes <= limits.outstanding_bytes):
                return
            clock.sleep_until_us(now_us + POLL_STEP_US)
            self.poll(clock.now_us())

    def send(self, request: Request) -> tuple[int, int]:
        """Send as soon as the board accepts it, without waiting for the reply.

        Returns:
            Sequence number, and host time in us at which it was sent.

        Raises:
            DeviceError: the port is gone.
        """
        payload = request.pack()
        if self._outstanding:
            self.wait_for_room(len(payload))
        sequence = next(self._sequences)
        now_us = self._clock.now_us()
        self._write(encode_frame(request.ID, sequence, payload), sequence, now_us)
        return sequence, now_us

    def request(self, request: Request, attempts: int = ATTEMPTS) -> Message:
        """Send and wait for the answer; if none comes, repeat with the same sequence number.

        Raises:
            BoardSilentError: no answer to any attempt.
            RequestRefusedError: the board answered `nack`.
            DeviceError: the port is gone.
        """
        payload = request.pack()
        if request.ID != Stop.ID:
            self.wait_for_room(len(payload))
        sequence = next(self._sequences)
        frame = encode_frame(request.ID, sequence, payload)
        awaited = self._awaited = _Awaited(request, sequence)
        try:
            for attempt in range(attempts):
                sent_us = self._clock.now_us()
                if attempt > 0:
                    self._counts.retries += 1
                self._write(frame, sequence, sent_us)
                answer = self._wait_for_answer(awaited, sent_us + ANSWER_TIMEOUT_US)
                if answer is not None:
                    if attempt == 0:
                        self._counts.round_trips_us.append(answer.time_us - sent_us)
                    if isinstance(nack := answer.message, Nack):
                        raise RequestRefusedError(type(request), nack.code, nack.detail)
                    return answer.message
        finally:
            self._awaited = None
        raise BoardSilentError(
            self._transport.name,
            request.NAME,
            heard_before=self._heard_board,
            foreign=self._foreign,
        )

    def poll(self, now_us: int) -> None:
        """Process what has arrived."""
        data = self._transport.read()
        if not self._heard_board:
            self._foreign = (self._foreign + data)[:_FOREIGN_BYTES]
        for item in self._decoder.feed(data) if data else ():
            if isinstance(item, FramingError):
                self._counts.framing_errors[item] += 1
            else:
                self._take(item, now_us)
        self._polled_us = now_us

    def note_round_trip(self, sent_us: int, received_us: int) -> None:
        """Count a round trip that was awaited elsewhere, if polling was frequent enough."""
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

    def _write(self, frame: bytes, sequence: int, now_us: int) -> None:
        self._counts.sent += 1
        self._outstanding[sequence] = len(frame), now_us
        if self._on_frame:
            self._on_frame("sent", now_us, frame)
        self._transport.write(frame)

    def _take(self, frame: Frame, now_us: int) -> None:
        self._counts.received += 1
        if self._on_frame:
            self._on_frame(
                "received", now_us, encode_frame(frame.id, frame.sequence, frame.payload)
            )
        message = message_in(frame)
        if message is None:
            return
        self._heard_board |= not isinstance(message, Request)  # an echo is not an answer
        if not isinstance(message, Telemetry):
            self._outstanding.pop(frame.sequence, None)
        received = Received(message, frame.sequence, now_us)
        if self._awaited and self._awaited.matches(message, frame.sequence):
            self._awaited.answer = received
        else:
            self._on_message(received)


def message_in(frame: Frame) -> Message | None:
    """The message that a frame carries; None if it is not one of the protocol."""
    kind = MESSAGES.get(frame.id)
    try:
        return None if kind is None else kind.unpack(frame.payload)
    except PayloadError:
        return None
