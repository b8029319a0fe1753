"""The serial line between host and emulated board, with its transmission time."""

from __future__ import annotations

from collections import deque

from ccr_host.core.wire import wire_time_us
from ccr_host.link.messages import BAUD, FRAME_DELIMITER, ResetCause
from ccr_host.sim.board.board import UnoEmulator

DISPATCH_LATENCY_US = 50
"""Time from the last bit of a request to its dispatch: one pass of the firmware's main loop."""


class SerialLine:
    """Advances the board and the bytes in order of time; its host end is a transport.

    Transmission starts when bytes are written. The board receives the bytes of a frame together
    when the last one has arrived; its decoder cannot tell the difference.
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
