"""Device URIs: which board to talk to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ccr_host.errors import ConfigError

KNOWN_FORMS = "emulator:, emulator+pty:, simavr:[FILE.elf], serial:PORT, tcp://HOST:PORT"


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
        """Whether the board is another one's: real, for all that this program knows."""
        return self.kind in (DeviceKind.SERIAL, DeviceKind.TCP)

    def __str__(self) -> str:
        separator = "://" if self.kind is DeviceKind.TCP else ":"
        return f"{self.kind.value}{separator}{self.address}"


def parse_device_uri(text: str) -> DeviceUri:
    """Read a device URI.

    Raises:
        ConfigError: unknown form, or one that lacks its port.
    """
    scheme, colon, rest = text.partition(":")
    try:
        kind = DeviceKind(scheme)
    except ValueError:
        kind = None
    if kind is None or not colon:
        raise ConfigError(f"device {text}: unknown form", f"use one of {KNOWN_FORMS}")
    match kind:
        case DeviceKind.EMULATOR | DeviceKind.EMULATOR_PTY:
            return _without_address(kind, text, rest)
        case DeviceKind.SIMAVR:
            return DeviceUri(kind, rest)
        case DeviceKind.SERIAL:
            return _serial(text, rest)
        case DeviceKind.TCP:
            return DeviceUri(kind, _host_and_port(text, rest))


def _without_address(kind: DeviceKind, text: str, rest: str) -> DeviceUri:
    if rest:
        raise ConfigError(f"device {text}: nothing may follow the colon", f"write {kind.value}:")
    return DeviceUri(kind)


def _serial(text: str, port: str) -> DeviceUri:
    if not port:
        raise ConfigError(f"device {text}: the port is missing", "write e.g. serial:/dev/ttyACM0")
    return DeviceUri(DeviceKind.SERIAL, port)


def _host_and_port(text: str, rest: str) -> str:
    host, colon, port = rest.removeprefix("//").rpartition(":")
    if not (rest.startswith("//") and colon and host and port.isascii() and port.isdigit()):
        raise ConfigError(
            f"device {text}: not a host and a port", "write e.g. tcp://localhost:5025"
        )
    if not 0 < int(port) <= 65535:  # noqa: PLR2004 - TCP ports are 16 bits wide
        raise ConfigError(f"device {text}: port {port} is not in 1..65535", "choose another one")
    return f"{host}:{port}"
