"""Communication with a device, frame by frame in the order in which the board sent them."""

from __future__ import annotations

from collections import deque

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from tests.conformance.device import Device

_STEP_US = 100
_LISTENING_STEP_US = 5_000
"""Polling period without a specific expectation."""


class Talk:
    """What was sent after an answer stays unread until it is asked for.

    So whatever was read last tells how far the board was when it answered.
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.forget()

    def forget(self) -> None:
        """Start again, as after a reset."""
        self.stream: list[tuple[int, m.StateReport]] = []
        """Telemetry read so far, with its sequence numbers."""
        self._read_before_answer = 0
        self._decoder = FrameDecoder()
        self._unread: deque[Frame] = deque()

    @property
    def stream_since_answer(self) -> list[tuple[int, m.StateReport]]:
        """Telemetry that the board has sent after its last answer, as far as it was read."""
        return self.stream[self._read_before_answer :]

    def exchange(self, data: bytes, wait_us: int = m.TICK_US) -> list[Frame]:
        """All that the board answers to raw bytes, the last of them a zero.

        It is what comes before the answer to a question asked after them, `wait_us` later: a board
        that has just started cannot take in more than its receive buffer holds.
        """
        self.device.send(data)
        answers = self.listen(wait_us)
        end = self.ask_frame(m.ClockSync.ID, 0, m.ClockSync(0).pack())
        while end.id != m.ClockReply.ID:
            answers.append(end)
            end = self._read_answer()
        return answers

    def listen(self, wait_us: int) -> list[Frame]:
        """Everything but telemetry that the board sends in that time."""
        deadline_us = self.device.since_reset_us() + wait_us
        answers = []
        while frame := self.read_frame(deadline_us, _LISTENING_STEP_US):
            if frame.id != m.Telemetry.ID:
                answers.append(frame)
        return answers

    def ask_frames(self, data: bytes, count: int = 1) -> list[Frame]:
        """The given number of answers to raw bytes, as soon as they have arrived."""
        self.device.send(data)
        return [self._read_answer() for _ in range(count)]

    def ask_frame(self, message_id: int, sequence: int, payload: bytes) -> Frame:
        """The answer to a frame."""
        (answer,) = self.ask_frames(encode_frame(message_id, sequence, payload))
        return answer

    def _read_answer(self) -> Frame:
        deadline_us = self.device.since_reset_us() + self.device.answer_timeout_us
        reports = 0
        while frame := self.read_frame(deadline_us):
            if frame.id != m.Telemetry.ID:
                return frame
            reports += 1
        raise AssertionError(f"no answer, but {reports} reports of the stream meanwhile")

    def read_frame(self, deadline_us: int, step_us: int = _STEP_US) -> Frame | None:
        """The next frame, or None if there is none before the deadline."""
        while not self._unread:
            now_us = self.device.since_reset_us()
            if now_us >= deadline_us:
                return None
            self.device.advance_to(min(now_us + step_us, deadline_us))
            for frame in self._decoder.feed(self.device.read()):
                assert isinstance(frame, Frame), "the board has sent what is no frame"
                self._unread.append(frame)
        frame = self._unread.popleft()
        if frame.id == m.Telemetry.ID:
            self.stream.append((frame.sequence, m.Telemetry.unpack(frame.payload).report))
        else:
            self._read_before_answer = len(self.stream)
        return frame
