"""The board's sending half of the UART: bytes leave one after the other."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from ccr_host.emulator.wire_time import bytes_in, wire_time_us
from ccr_host.link.messages import SEND_BYTES


@dataclass(slots=True)
class _Sending:
    start_us: int
    data: bytes
    taken: int = 0


class SendBuffer:
    """Frames on their way out.

    Args:
        baud: of the line.
    """

    def __init__(self, baud: int) -> None:
        self._baud = baud
        self._frames: deque[_Sending] = deque()
        self._free_us = 0

    def offer(self, frame: bytes, now_us: int, spare_bytes: int = 0) -> bool:
        """Queue a frame; False if it does not fit, or would leave less than `spare_bytes`."""
        start_us = max(now_us, self._free_us)
        waiting = bytes_in(start_us - now_us, self._baud)
        if waiting + len(frame) + spare_bytes > SEND_BYTES:
            return False
        self._frames.append(_Sending(start_us, frame))
        self._free_us = start_us + wire_time_us(len(frame), self._baud)
        return True

    def take(self, now_us: int) -> bytes:
        """Bytes whose last bit has left by now."""
        if not self._frames:
            return b""
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
        """When the first queued frame will have left."""
        if not self._frames:
            return None
        head = self._frames[0]
        return head.start_us + wire_time_us(len(head.data), self._baud)
