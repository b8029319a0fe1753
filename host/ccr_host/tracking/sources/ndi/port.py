"""The line to a camera: like a board's transport, with a baud rate that changes and a break."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, repeat
from pathlib import Path
from typing import Protocol

from ccr_host.core.byte_port import CONNECT_TIMEOUT_S, BytePort, Peer
from ccr_host.core.errors import TrackerError

_RESET_BAUD = 9600
_RECONNECT_TIMEOUT_S = 0.1
"""In mid-run the board waits meanwhile for its next target."""
_CAMERA = Peer("camera", TrackerError, if_refused="check address and power of the camera")


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


class SerialPort(BytePort):
    """A serial port or a pseudo-terminal.

    Raises:
        TrackerError: the port cannot be opened; the cure tells what to do.
    """

    has_baud = True

    def __init__(self, path: str) -> None:
        self.has_break = not str(Path(path).resolve()).startswith("/dev/pts/")
        super().__init__(f"ndi:{path}", path, _CAMERA, _RESET_BAUD)


class TcpPort(BytePort):
    """A TCP socket: HOST:PORT of a camera (Polaris Vega: port 8765) or of an emulator.

    Raises:
        TrackerError: the port cannot be opened; the cure tells what to do.
    """

    has_baud = False
    has_break = False

    def __init__(self, address: str, connect_timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        super().__init__(f"ndi+tcp://{address}", address, _CAMERA, None, connect_timeout_s)

    def set_baud(self, baud: int) -> None:
        """Nothing to set."""

    def set_break(self, on: bool) -> None:
        """Nothing to hold."""


def tcp_opener(address: str) -> PortOpener:
    """Opens a TCP port again and again; only the first time, when nothing moves, may take long."""
    timeouts_s = chain([CONNECT_TIMEOUT_S], repeat(_RECONNECT_TIMEOUT_S))
    return lambda: TcpPort(address, next(timeouts_s))
