"""The emulated board's port as a TCP socket, one client at a time."""

from __future__ import annotations

import selectors
import socket

from ccr_host.addresses import joined, listening_socket
from ccr_host.emulator.server import PortListener

DEFAULT_HOST = "127.0.0.1"
_READ_BYTES = 4096
_BUSY = b"busy: another host is connected to this board\r\n"


class TcpPort:
    """Listens for one client; a second one is told that the board is taken.

    Args:
        port: 0 lets the system choose one.
        host: address to listen on.

    Raises:
        ConfigError: the port is in use or may not be used.
    """

    def __init__(self, port: int, host: str = DEFAULT_HOST) -> None:
        self._listening = listening_socket(host, port)
        self._listening.setblocking(False)
        self.uri = f"tcp://{joined(host, self._listening.getsockname()[1])}"
        self._client: socket.socket | None = None

    def register(self, selector: selectors.BaseSelector, listener: PortListener) -> None:
        self._selector = selector
        self._listener = listener
        selector.register(self._listening, selectors.EVENT_READ, self._accept)

    def look_for_client(self) -> None:
        """Nothing to do: a socket tells by itself."""

    def send(self, data: bytes) -> None:
        if self._client is None or not data:
            return
        try:
            self._client.send(data)
        except BlockingIOError:
            return
        except OSError:
            self._drop_client()

    def close(self) -> None:
        self._drop_client()
        self._listening.close()

    def _accept(self) -> None:
        try:
            client, _ = self._listening.accept()
        except OSError:
            return  # gone before it was answered
        client.setblocking(False)
        if self._client is not None:
            _refuse(client)
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        self._selector.register(client, selectors.EVENT_READ, self._read)
        self._listener.opened()

    def _read(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(_READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data and not _is_of_a_browser(data):
            self._listener.received(data)
        else:
            self._drop_client()

    def _drop_client(self) -> None:
        if self._client is not None:
            self._selector.unregister(self._client)
            self._client.close()
            self._client = None


def _is_of_a_browser(data: bytes) -> bool:
    """Whether it is an HTTP request: any web site can send one here, with frames in its body."""
    return b" HTTP/1." in data.partition(b"\r\n")[0]


def _refuse(client: socket.socket) -> None:
    with client:
        try:
            client.send(_BUSY)
        except OSError:
            return
