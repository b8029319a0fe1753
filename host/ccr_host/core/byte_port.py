"""Serial ports (through pyserial) and TCP sockets, for boards and cameras.

Every failure is raised as one type of error, with a cause and a cure.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

import serial
from serial.tools import list_ports

from ccr_host.core.addresses import host_and_port
from ccr_host.core.errors import DeviceError, TrackerError

Trouble = tuple[str, str]
"""Cause and cure."""

_READ_BYTES = 4096
_WRITE_TIMEOUT_S = 1.0
"""Longer than any frame takes on the slowest line; only a dead port takes this long."""
CONNECT_TIMEOUT_S = 5.0
_LAST_WORDS_BYTES = 120

_CANNOT_OPEN: Final[Mapping[int, Trouble]] = {
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM),
        (
            "permission denied",
            "join the group of the port, which ls -l shows, usually: "
            "sudo usermod -aG dialout $USER; then log in again",
        ),
    ),
    **dict.fromkeys(
        (errno.ENOENT, errno.ENOTDIR, errno.ENODEV),
        ("there is no such port", "plug the {noun} in; {ports}"),
    ),
    **dict.fromkeys(
        (errno.EIO, errno.ENXIO), ("nothing is behind this port", "plug the {noun} in; {ports}")
    ),
    **dict.fromkeys((errno.ENOTTY, errno.EISDIR), ("not a serial port", "{ports}")),
    **dict.fromkeys(
        (errno.EBUSY, errno.EAGAIN), ("in use by another program", "close that program")
    ),
    errno.ECONNREFUSED: ("connection refused", "{if_refused}"),
    **dict.fromkeys(
        (errno.ETIMEDOUT, errno.ENETUNREACH, errno.EHOSTUNREACH),
        ("the host does not answer", "check its address, its power and the network"),
    ),
}
_WINDOWS_NUMBERS: Final = {"FileNotFoundError": errno.ENOENT, "PermissionError": errno.EBUSY}
"""Numbers by name, as pyserial gives only the name of the system's error on Windows."""


@dataclass(frozen=True)
class Peer:
    """The device at the other end, for messages."""

    noun: str
    error: type[DeviceError] | type[TrackerError]
    if_refused: str
    """Cure for a refused TCP connection."""


class _Socket:
    """A TCP socket with pyserial's methods.

    pyserial's own discards what the other end sends on connecting, such as "busy".
    """

    def __init__(self, address: str, connect_timeout_s: float) -> None:
        where = host_and_port(address, address, "localhost:5025")
        self._socket = socket.create_connection(where, connect_timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def write(self, data: bytes) -> None:
        self._socket.settimeout(_WRITE_TIMEOUT_S)
        self._socket.sendall(data)

    def read(self, size: int) -> bytes:
        self._socket.settimeout(0)
        try:
            data = self._socket.recv(size)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionError("end of file")
        return data

    def close(self) -> None:
        self._socket.close()


class BytePort:
    """An open port; the peer's error from any method means that the port is lost.

    Args:
        name: URI of the port, for messages.
        address: device file, or HOST:PORT for TCP.
        peer: the device at the other end.
        baud: initial bit rate; None for TCP.
        connect_timeout_s: TCP only, for each address of the host.

    Raises:
        DeviceError, TrackerError: the port cannot be opened; the error states the cure.
    """

    def __init__(
        self,
        name: str,
        address: str,
        peer: Peer,
        baud: int | None,
        connect_timeout_s: float = CONNECT_TIMEOUT_S,
    ) -> None:
        self.name = name
        self._peer = peer
        self._is_tcp = baud is None
        self._heard = b""
        self._port: Any
        with self._told(self._cannot_open):
            if self._is_tcp:
                self._port = _Socket(address, connect_timeout_s)
            else:
                self._port = serial.Serial(
                    address, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True
                )

    def write(self, data: bytes) -> None:
        """Send bytes.

        A process that was stopped while writing times out although the port would have taken the
        bytes, so the write is tried once more. Bytes sent twice this way end up in a frame that
        the peer rejects, or to which it repeats its answer.
        """
        with self._told(self._lost):
            try:
                self._port.write(data)
            except (serial.SerialTimeoutException, TimeoutError):
                self._port.write(data)

    def read(self) -> bytes:
        """Return the bytes that have arrived, possibly none; never waits."""
        with self._told(self._lost):
            data: bytes = self._port.read(_READ_BYTES)
        if data and self._is_tcp:
            self._heard = (self._heard + data)[-_LAST_WORDS_BYTES:]
        return data

    def set_baud(self, baud: int) -> None:
        with self._told(self._no_rate):
            self._port.baudrate = baud

    def set_break(self, on: bool) -> None:
        with self._told(self._lost):
            self._port.break_condition = on

    def close(self) -> None:
        """Close the port; never raises, even if the port is already gone."""
        with suppress(Exception):
            self._port.close()

    @contextmanager
    def _told(self, tell: Callable[[Exception], Trouble]) -> Iterator[None]:
        """Turn every exception of a port into the peer's error.

        pyserial lets many others through: termios.error, OverflowError for a rate that is not a
        32-bit number, TypeError once the port is closed.
        """
        try:
            yield
        except Exception as error:
            cause, cure = tell(error)
            raise self._peer.error(f"{self.name}: {cause}", cure) from None

    def _cannot_open(self, error: Exception) -> Trouble:
        if isinstance(error, socket.gaierror):
            return "unknown host name", "check the spelling, or give the host's address"
        trouble = _CANNOT_OPEN.get(_system_number(error))
        if trouble is None:
            if isinstance(error, ValueError | OverflowError) or "baud rate" in str(error):
                return self._no_rate(error)
            trouble = f"cannot be opened: {error}", "check the name of the port; {ports}"
        cause, cure = trouble
        ports = ", ".join(sorted(port.device for port in list_ports.comports())) or "none"
        return cause, cure.format(
            noun=self._peer.noun,
            ports=f"ports of this computer: {ports}",
            if_refused=self._peer.if_refused,
        )

    def _no_rate(self, error: Exception) -> Trouble:
        return f"the port does not take this bit rate ({error})", "use an adapter that does"

    def _lost(self, error: Exception) -> Trouble:
        noun = self._peer.noun
        if isinstance(error, serial.SerialTimeoutException | TimeoutError):
            return (
                f"nothing could be sent for {2 * _WRITE_TIMEOUT_S:g} s",
                f"check cable and power of the {noun}, or that the program that serves it runs",
            )
        if not self._is_tcp:
            return f"the port is gone ({error})", f"check cable and power of the {noun}"
        said = self._last_words()
        if "busy" in said.lower() or "in use" in said.lower():
            return f'in use by another host ("{said}")', "end that host's program"
        if said:
            return f'this is not a {noun}, it says "{said}"', "check host and port"
        return (
            f"the other end has closed the connection ({error})",
            f"check the program at the other end, the power of the {noun}, and the network",
        )

    def _last_words(self) -> str:
        """Text that the other end sent before it closed the connection; empty if not text."""
        with suppress(Exception):
            self._heard += self._port.read(_READ_BYTES)
        text = self._heard[:_LAST_WORDS_BYTES].decode("ascii", errors="replace")
        line = " ".join(text.split())
        return line if line.isascii() and line.isprintable() else ""


def _system_number(error: Exception) -> int:
    """Errno of the system error, whether or not pyserial has wrapped it; 0 if there is none."""
    for one in (error, error.__context__):
        if isinstance(one, TimeoutError):
            return errno.ETIMEDOUT
        first = one.args[0] if one is not None and one.args else None
        number = getattr(one, "errno", None) or first
        if isinstance(number, int):
            return number
    return next((n for name, n in _WINDOWS_NUMBERS.items() if name in str(error)), 0)
