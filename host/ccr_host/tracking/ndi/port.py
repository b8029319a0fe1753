"""The line to a camera: like a board's transport, with a baud rate that changes and a break."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial

from ccr_host.errors import TrackerError

_READ_BYTES = 4096
_WRITE_TIMEOUT_S = 1.0


class Port(Protocol):
    """A byte stream; `TrackerError` from any method means that the port is lost."""

    name: str
    has_baud: bool
    """Whether the rate means anything here; not so on TCP."""
    has_break: bool
    """Whether a break reaches the device; not so on TCP and pseudo-terminals."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Bytes that have arrived; empty if none have, never waits."""

    def set_baud(self, baud: int) -> None:
        """Change the rate of both directions from now on."""

    def set_break(self, on: bool) -> None:
        """Hold the line in the break state or let go of it."""

    def close(self) -> None:
        """Let go of the port."""


PortOpener = Callable[[], Port]


class SerialPort:
    """A serial port or a pseudo-terminal.

    Raises:
        TrackerError: the port cannot be opened; the cure tells what to do.
    """

    has_baud = True

    def __init__(self, path: str) -> None:
        self.name = f"ndi:{path}"
        self.has_break = not str(Path(path).resolve()).startswith("/dev/pts/")
        self._port = _open(self.name, path, exclusive=True)

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:  # TypeError: pyserial after the port was closed
            raise _lost(self.name, error) from None

    def read(self) -> bytes:
        try:
            data: bytes = self._port.read(_READ_BYTES)
        except (OSError, TypeError) as error:
            raise _lost(self.name, error) from None
        return data

    def set_baud(self, baud: int) -> None:
        try:
            self._port.baudrate = baud
        except (OSError, ValueError) as error:
            raise _lost(self.name, error) from None

    def set_break(self, on: bool) -> None:
        try:
            self._port.break_condition = on
        except OSError as error:
            raise _lost(self.name, error) from None

    def close(self) -> None:
        self._port.close()


class TcpPort(SerialPort):
    """A TCP socket: HOST:PORT of a camera (Polaris Vega: port 8765) or of an emulator."""

    has_baud = False

    def __init__(self, address: str) -> None:
        self.name = f"ndi+tcp://{address}"
        self.has_break = False
        self._port = _open(self.name, f"socket://{address}")

    def set_baud(self, baud: int) -> None:
        """Nothing to set."""

    def set_break(self, on: bool) -> None:
        """Nothing to hold."""


def _open(name: str, url: str, **options: bool) -> serial.SerialBase:
    try:
        return serial.serial_for_url(
            url, baudrate=9600, timeout=0, write_timeout=_WRITE_TIMEOUT_S, **options
        )
    except (OSError, ValueError) as error:
        raise _cannot_open(name, error) from None


def _cannot_open(name: str, error: Exception) -> TrackerError:
    text = str(error)
    number = getattr(error, "errno", None)
    if number == errno.EACCES or "Permission denied" in text:
        return TrackerError(
            f"{name}: permission denied", "sudo usermod -aG dialout $USER, then log in again"
        )
    if number == errno.ENOENT or "No such file" in text:
        return TrackerError(f"{name}: there is no such port", "plug the camera in; ls /dev/tty*")
    if "exclusively lock" in text or number == errno.EBUSY:
        return TrackerError(f"{name}: in use by another program", "close that program")
    if "refused" in text:
        return TrackerError(f"{name}: connection refused", "check address and power of the camera")
    return TrackerError(f"{name}: cannot be opened: {text}", "check the tracker URI and the cable")


def _lost(name: str, error: Exception) -> TrackerError:
    return TrackerError(
        f"{name}: the port is gone ({error})", "check cable and power of the camera"
    )
