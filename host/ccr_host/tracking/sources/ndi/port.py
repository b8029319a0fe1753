"""The port to a camera: like a board's transport, with a variable baud rate and a break."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, repeat
from pathlib import Path
from typing import Protocol

from ccr_host.core.byte_port import CONNECT_TIMEOUT_S, BytePort, Peer
from ccr_host.core.errors import TrackerError

_RESET_BAUD = 9600
_RECONNECT_TIMEOUT_S = 0.1
"""Time limit of a reconnection during a run, as the board waits for its next target."""
_CAMERA = Peer("camera", TrackerError, if_refused="check address and power of the camera")


class Port(Protocol):
    """A byte stream; `TrackerError` from any method means that the port is lost."""

    name: str
    has_baud: bool
    """Whether the rate has an effect; not on TCP."""
    has_break: bool
    """Whether a break reaches the device; not on TCP and pseudo-terminals."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Return the bytes that have arrived, possibly none; never waits."""

    def set_baud(self, baud: int) -> None:
        """Change the rate of both directions."""

    def set_break(self, on: bool) -> None:
        """Begin or end the break state of the line."""

    def close(self) -> None:
        """Close the port."""


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
        """TCP has no rate."""

    def set_break(self, on: bool) -> None:
        """TCP has no break."""


def tcp_opener(address: str) -> PortOpener:
    """A function that opens a TCP port; only its first call, when nothing moves, may be slow."""
    timeouts_s = chain([CONNECT_TIMEOUT_S], repeat(_RECONNECT_TIMEOUT_S))
    return lambda: TcpPort(address, next(timeouts_s))
