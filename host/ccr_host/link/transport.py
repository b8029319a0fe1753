"""Ways for bytes to and from a board."""

from __future__ import annotations

from typing import Protocol

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.link.byte_port import BytePort, Peer
from ccr_host.link.messages import BAUD
from ccr_host.link.uri import DeviceKind, DeviceUri

_BOARD = Peer("board", DeviceError, if_refused="start the server: ccr-host emulate")


class Transport(Protocol):
    """A byte stream; `DeviceError` from any method means that the port is lost."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def read(self) -> bytes:
        """Bytes that have arrived; empty if none have, never waits."""

    def close(self) -> None:
        """Let go of the port."""


def open_transport(uri: DeviceUri, baud: int = BAUD) -> Transport:
    """Open a port outside this process: serial, pseudo-terminal or TCP.

    Args:
        uri: `serial:` or `tcp:`.
        baud: without meaning on TCP.

    Raises:
        ConfigError: the URI names an emulator, which has to be made first.
        DeviceError: the port cannot be opened; the cure tells what to do.
    """
    match uri.kind:
        case DeviceKind.SERIAL:
            return BytePort(str(uri), uri.address, _BOARD, baud)
        case DeviceKind.TCP:
            return BytePort(str(uri), uri.address, _BOARD, baud=None)
    raise ConfigError(f"device {uri}: not a port", "use serial:PORT or tcp://HOST:PORT")
