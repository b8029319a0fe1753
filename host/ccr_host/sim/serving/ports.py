"""Ports of emulated devices: a pseudo-terminal or a TCP socket, one client at a time."""

from __future__ import annotations

import errno
import os
import select
import selectors
import socket
from contextlib import suppress

from ccr_host.core.addresses import joined, listening_socket
from ccr_host.core.errors import ConfigError
from ccr_host.sim.serving.server import Station

try:
    import pty
    import termios
    import tty
except ModuleNotFoundError:  # on Windows
    _SUPPORTED = False
else:
    _SUPPORTED = True

_READ_BYTES = 4096
_LFLAG = 3


class PtyPort:
    """A pseudo-terminal whose other end is opened like a serial port.

    Raises:
        ConfigError: this computer has none.
    """

    def __init__(self) -> None:
        if not _SUPPORTED:
            raise ConfigError(
                "this system has no pseudo-terminals", "use emulator:, or emulate --tcp HOST:PORT"
            )
        try:
            self._master, slave = pty.openpty()
            self._path = os.ttyname(slave)
            tty.setraw(slave)
        except (OSError, termios.error) as error:
            raise ConfigError(
                f"no pseudo-terminal to serve on ({error})",
                "check that /dev/pts is mounted and not full, or serve on --tcp",
            ) from None
        self.uri = f"serial:{self._path}"
        os.set_blocking(self._master, False)
        os.close(slave)  # a client can be detected only if no slave is open here
        self._hang_up = select.poll()
        self._hang_up.register(self._master, 0)
        self._client = False

    def register(self, selector: selectors.BaseSelector, station: Station) -> None:
        self._selector = selector
        self._station = station

    def look_for_client(self) -> None:
        """Detect by polling that a client came or left; the kernel signals no reopening."""
        present = not self._hang_up.poll(0)
        if present == self._client:
            return
        self._client = present
        if present:
            self._make_raw()
            self._selector.register(self._master, selectors.EVENT_READ, self._read)
            self._station.opened()
        else:
            self._selector.unregister(self._master)

    def send(self, data: bytes) -> None:
        if not (self._client and data):
            return
        try:
            os.write(self._master, data)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise

    def close(self) -> None:
        os.close(self._master)

    def _read(self) -> None:
        try:
            data = os.read(self._master, _READ_BYTES)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            self.look_for_client()
            return
        self._station.received(data)

    def _make_raw(self) -> None:
        """Set raw mode: the kernel restores cooked mode on the last close, clients may keep it."""
        with suppress(termios.error):  # the client may already be gone
            if termios.tcgetattr(self._master)[_LFLAG] & (termios.ECHO | termios.ICANON):
                tty.setraw(self._master)


DEFAULT_HOST = "127.0.0.1"
_BUSY = b"busy: another host is connected to this board\r\n"


class TcpPort:
    """Listens for one client; a second one is sent "busy".

    Port 0 lets the system choose one.

    Raises:
        ConfigError: the port is in use or not allowed.
    """

    def __init__(self, port: int, host: str = DEFAULT_HOST) -> None:
        self._listening = listening_socket(host, port)
        self._listening.setblocking(False)
        self.uri = f"tcp://{joined(host, self._listening.getsockname()[1])}"
        self._client: socket.socket | None = None

    def register(self, selector: selectors.BaseSelector, station: Station) -> None:
        self._selector = selector
        self._station = station
        selector.register(self._listening, selectors.EVENT_READ, self._accept)

    def look_for_client(self) -> None:
        """Do nothing: the selector reports clients of a socket."""

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
            return  # the client left before it was accepted
        client.setblocking(False)
        self._hear_all()
        if self._client is not None:
            _refuse(client)
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        self._selector.register(client, selectors.EVENT_READ, self._read)
        self._station.opened()

    def _read(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(_READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data and not _is_http(data):
            self._station.received(data)
        else:
            self._drop_client()

    def _hear_all(self) -> None:
        """Read what has arrived: the client may have left before the next one came."""
        while self._client is not None and select.select([self._client], [], [], 0)[0]:
            self._read()

    def _drop_client(self) -> None:
        if self._client is not None:
            self._selector.unregister(self._client)
            self._client.close()
            self._client = None


def _is_http(data: bytes) -> bool:
    """Whether it is an HTTP request: any web site can send one here, with frames in its body."""
    return b" HTTP/1." in data.partition(b"\r\n")[0]


def _refuse(client: socket.socket) -> None:
    with client:
        try:
            client.send(_BUSY)
        except OSError:
            return
