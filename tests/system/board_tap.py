"""A tap on the line between host and board, which keeps the board's port open."""

from __future__ import annotations

import selectors
import socket
import time
from contextlib import suppress
from threading import Thread

from ccr_host.link.framing import Frame, FrameDecoder
from ccr_host.link.messages import MESSAGES, StateReport, Telemetry


class BoardTap:
    """Stands for the board where the host connects.

    A board is reset when its port is opened, so a new connection could not see what a host that is
    gone has left behind.
    """

    def __init__(self, board_uri: str) -> None:
        self._address = board_uri.removeprefix("tcp://").rsplit(":", 1)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.uri = f"tcp://127.0.0.1:{self._listening.getsockname()[1]}"
        self.from_host: list[tuple[float, Frame]] = []
        """Arrival, s, and frame."""
        self.reports: list[StateReport] = []
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def wait_for(self, is_there, timeout_s: float) -> bool:
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            if any(is_there(report) for report in list(self.reports)):
                return True
            time.sleep(0.02)
        return False

    def _run(self) -> None:
        host, _ = self._listening.accept()
        board = socket.create_connection((self._address[0], int(self._address[1])))
        from_host, from_board = FrameDecoder(), FrameDecoder()
        with selectors.DefaultSelector() as selector:
            for end in (host, board):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                selector.register(end, selectors.EVENT_READ)
            while True:
                ready = {key.fileobj for key, _ in selector.select()}
                if board in ready:
                    data = board.recv(4096)
                    if not data:
                        return
                    self._note_reports(from_board.feed(data))
                    with suppress(ConnectionError):
                        host.sendall(data)
                if host in ready:
                    data = _received(host)
                    if not data:
                        selector.unregister(host)
                        continue
                    frames = (f for f in from_host.feed(data) if isinstance(f, Frame))
                    self.from_host += [(time.monotonic(), frame) for frame in frames]
                    board.sendall(data)

    def _note_reports(self, found) -> None:
        for frame in found:
            if isinstance(frame, Frame) and frame.id == Telemetry.ID:
                self.reports.append(MESSAGES[frame.id].unpack(frame.payload).report)


def _received(host: socket.socket) -> bytes:
    try:
        return host.recv(4096)
    except ConnectionError:
        return b""
