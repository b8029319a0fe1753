"""Serial ports and TCP sockets through pyserial, for boards and cameras alike.

Whatever goes wrong comes out as one kind of error, with a cause and a cure.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass

import serial

from ccr_host.errors import DeviceError, TrackerError

_READ_BYTES = 4096
_WRITE_TIMEOUT_S = 1.0
"""Longer than any frame takes on the slowest line; only a dead port waits so long."""


@dataclass(frozen=True)
class Peer:
    """Who is at the other end, for messages."""

    noun: str
    error: type[DeviceError] | type[TrackerError]
    if_refused: str
    """What to do where nobody listens on a TCP port."""


class BytePort:
    """An open port; the peer's error from any method means that it is lost.

    Args:
        name: its URI, for messages.
        url: a device file, or `socket://HOST:PORT`.
        peer: at the other end.
        baud: to begin with; without meaning on TCP.

    Raises:
        DeviceError, TrackerError: the port cannot be opened; the cure tells what to do.
    """

    def __init__(self, name: str, url: str, peer: Peer, baud: int) -> None:
        self.name = name
        self._peer = peer
        options = {} if url.startswith("socket://") else {"exclusive": True}
        try:
            self._port = serial.serial_for_url(
                url, baudrate=baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, **options
            )
        except (OSError, ValueError) as error:
            raise self._cannot_open(error) from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:  # TypeError: pyserial after the port was closed
            raise self._lost(error) from None

    def read(self) -> bytes:
        """Bytes that have arrived; empty if none have, never waits."""
        try:
            data: bytes = self._port.read(_READ_BYTES)
        except (OSError, TypeError) as error:
            raise self._lost(error) from None
        return data

    def set_baud(self, baud: int) -> None:
        """Change the rate of both directions from now on."""
        try:
            self._port.baudrate = baud
        except (OSError, ValueError) as error:
            raise self._lost(error) from None

    def set_break(self, on: bool) -> None:
        """Hold the line in the break state or let go of it."""
        try:
            self._port.break_condition = on
        except OSError as error:
            raise self._lost(error) from None

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()

    def _cannot_open(self, error: Exception) -> DeviceError | TrackerError:
        text = str(error)
        number = getattr(error, "errno", None)
        noun = self._peer.noun
        if number == errno.EACCES or "Permission denied" in text:
            cause, cure = "permission denied", "sudo usermod -aG dialout $USER, then log in again"
        elif number == errno.ENOENT or "No such file" in text:
            cause, cure = "there is no such port", f"plug the {noun} in; see ls /dev/tty*"
        elif "exclusively lock" in text or number == errno.EBUSY:
            cause, cure = "in use by another program", "close that program"
        elif "refused" in text:
            cause, cure = "connection refused", self._peer.if_refused
        else:
            cause, cure = f"cannot be opened: {text}", f"check the URI and cable of the {noun}"
        return self._peer.error(f"{self.name}: {cause}", cure)

    def _lost(self, error: Exception) -> DeviceError | TrackerError:
        return self._peer.error(
            f"{self.name}: the port is gone ({error})",
            f"check cable and power of the {self._peer.noun}",
        )
