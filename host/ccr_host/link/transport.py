"""Device URIs, and the ports that carry bytes to and from a board."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ccr_host.core.addresses import Role, split_uri, tcp_address
from ccr_host.core.byte_port import BytePort, Peer
from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.link.exchange import Transport
from ccr_host.link.messages import BAUD


class DeviceKind(Enum):
    """How the board is reached."""

    EMULATOR = "emulator"
    EMULATOR_PTY = "emulator+pty"
    SIMAVR = "simavr"
    SERIAL = "serial"
    TCP = "tcp"


@dataclass(frozen=True, slots=True)
class DeviceUri:
    """A parsed device URI."""

    kind: DeviceKind
    address: str = ""
    """Port of `serial:`, HOST:PORT of `tcp:`, firmware of `simavr:`; empty for the emulators."""

    @property
    def in_process(self) -> bool:
        """Whether the board is simulated in this process, in step with its clock."""
        return self.kind in (DeviceKind.EMULATOR, DeviceKind.SIMAVR)

    @property
    def is_outside(self) -> bool:
        """Whether the board is outside this program, and so possibly real."""
        return self.kind in (DeviceKind.SERIAL, DeviceKind.TCP)

    def __str__(self) -> str:
        separator = "://" if self.kind is DeviceKind.TCP else ":"
        return f"{self.kind.value}{separator}{self.address}"


def parse_device_uri(text: str) -> DeviceUri:
    """Read a device URI.

    Raises:
        ConfigError: unknown form, or one that lacks its port.
    """
    scheme, rest = split_uri(Role.DEVICE, text)
    kind = DeviceKind(scheme)
    if kind is DeviceKind.SERIAL and not rest:
        raise ConfigError(f"device {text}: the port is missing", "write e.g. serial:/dev/ttyACM0")
    if kind is DeviceKind.TCP:
        rest = tcp_address(rest, f"device {text}", "tcp://localhost:5025")
    return DeviceUri(kind, rest)


_BOARD = Peer("board", DeviceError, if_refused="start the server: ccr-host emulate")


def open_transport(uri: DeviceUri, baud: int = BAUD) -> Transport:
    """Open a port outside this process: serial, pseudo-terminal or TCP.

    The bit rate is ignored on TCP.

    Raises:
        ConfigError: the URI names an emulator, which has to be made first.
        DeviceError: the port cannot be opened; the cure says what to do.
    """
    if not uri.is_outside:
        raise ConfigError(f"device {uri}: not a port", "use serial:PORT or tcp://HOST:PORT")
    has_rate = uri.kind is DeviceKind.SERIAL
    return BytePort(str(uri), uri.address, _BOARD, baud if has_rate else None)
