"""Requests and their answers: sequence numbers, retries, round trips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ccr_host.core.clock import Clock
from ccr_host.link.device_errors import BoardSilentError, RequestRefusedError
from ccr_host.link.framing import Frame, FrameDecoder, FramingError, encode_frame
from ccr_host.link.messages import (
    FRAME_DELIMITER,
    MESSAGES,
    RETRY_WINDOW_TICKS,
    TICK_US,
    Ack,
    Message,
    Nack,
    PayloadError,
    Request,
)
from ccr_host.link.statistics import LinkCounts
from ccr_host.link.transport import Transport

ANSWER_TIMEOUT_US = 100_000
"""Ten times the slowest answer seen through a USB serial adapter (16 ms latency timer)."""
ATTEMPTS = 8
POLL_STEP_US = 200
"""Five bytes at 250000 baud: the resolution of the round-trip times."""
_COARSE_POLL_US = 2000
"""A round trip read by a host that looked away for longer says nothing about the link."""
_U8 = 1 << 8

assert ATTEMPTS * ANSWER_TIMEOUT_US < RETRY_WINDOW_TICKS * TICK_US, "a late retry would run twice"

FrameObserver = Callable[[str, int, bytes], None]
"""Direction ("sent" or "received"), host time in us, the bytes of one frame."""


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

    def send(self, request: Request) -> int:
        """Send without waiting; gives the sequence number."""
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % _U8
        self._write(encode_frame(request.ID, sequence, request.pack()))
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
                self._write(frame)
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

    def _write(self, frame: bytes) -> None:
        self._counts.sent += 1
        if self._on_frame:
            self._on_frame("sent", self._clock.now_us(), frame)
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
