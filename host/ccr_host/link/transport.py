"""Ways for bytes to and from a board."""

from __future__ import annotations

import errno
from typing import Protocol

import serial

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.link.messages import BAUD
from ccr_host.link.uri import DeviceKind, DeviceUri

_READ_BYTES = 4096
_WRITE_TIMEOUT_S = 1.0
"""Longer than any frame takes on the slowest line; only a dead port waits so long."""


class Transport(Protocol):
    """A byte stream; `DeviceError` from any method means that the port is lost."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Bytes that have arrived; empty if none have, never waits."""

    def close(self) -> None:
        """Let go of the port."""


class SerialTransport:
    """A serial port, a pseudo-terminal or a TCP socket, through pyserial.

    Args:
        uri: `serial:` or `tcp:`.
        baud: without meaning on TCP.

    Raises:
        DeviceError: the port cannot be opened; the cure tells what to do.
    """

    def __init__(self, uri: DeviceUri, baud: int = BAUD) -> None:
        self.name = str(uri)
        is_tcp = uri.kind is DeviceKind.TCP
        options = {} if is_tcp else {"exclusive": True}
        try:
            self._port = serial.serial_for_url(
                f"socket://{uri.address}" if is_tcp else uri.address,
                baudrate=baud,
                timeout=0,
                write_timeout=_WRITE_TIMEOUT_S,
                **options,
            )
        except (OSError, ValueError) as error:
            raise _cannot_open(self.name, error) from None

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:  # TypeError: pyserial after the port was closed
            raise _port_lost(self.name, error) from None

    def read(self) -> bytes:
        try:
            data: bytes = self._port.read(_READ_BYTES)
        except (OSError, TypeError) as error:
            raise _port_lost(self.name, error) from None
        return data

    def close(self) -> None:
        self._port.close()


def open_transport(uri: DeviceUri, baud: int = BAUD) -> Transport:
    """Open a port outside this process.

    Raises:
        ConfigError: the URI names an emulator, which has to be made first.
        DeviceError: the port cannot be opened.
    """
    if uri.kind not in (DeviceKind.SERIAL, DeviceKind.TCP):
        raise ConfigError(f"device {uri}: not a port", "use serial:PORT or tcp://HOST:PORT")
    return SerialTransport(uri, baud)


def _cannot_open(name: str, error: Exception) -> DeviceError:
    text = str(error)
    number = getattr(error, "errno", None)
    if number == errno.EACCES or "Permission denied" in text:
        return DeviceError(
            f"{name}: permission denied", "sudo usermod -aG dialout $USER, then log in again"
        )
    if number == errno.ENOENT or "No such file" in text:
        return DeviceError(f"{name}: there is no such port", "plug the board in; see ls /dev/tty*")
    if "exclusively lock" in text or number == errno.EBUSY:
        return DeviceError(f"{name}: in use by another program", "close that program")
    if "refused" in text:
        return DeviceError(f"{name}: connection refused", "start the server: ccr-host emulate")
    return DeviceError(f"{name}: cannot be opened: {text}", "check the device URI and the cable")


def _port_lost(name: str, error: Exception) -> DeviceError:
    return DeviceError(f"{name}: the port is gone ({error})", "check cable and power of the board")
