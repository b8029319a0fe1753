"""Tracker URIs: where the markers' positions come from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ccr_host.errors import ConfigError

KNOWN_FORMS = (
    "twin:, ndi-emulator:, ndi:PORT, ndi+tcp://HOST:PORT, igtl://HOST:PORT, aruco:N, replay:FILE"
)
_LAST_TCP_PORT = 65535


class TrackerKind(Enum):
    """How positions are measured."""

    TWIN = "twin"
    NDI_EMULATOR = "ndi-emulator"
    NDI_SERIAL = "ndi"
    NDI_TCP = "ndi+tcp"
    IGTL = "igtl"
    ARUCO = "aruco"
    REPLAY = "replay"


_EXAMPLES = {
    TrackerKind.NDI_SERIAL: "ndi:/dev/ttyUSB0",
    TrackerKind.NDI_TCP: "ndi+tcp://192.168.1.20:8765",
    TrackerKind.IGTL: "igtl://localhost:18944",
    TrackerKind.ARUCO: "aruco:0",
    TrackerKind.REPLAY: "replay:runs/NAME",
}
_WITHOUT_ADDRESS = (TrackerKind.TWIN, TrackerKind.NDI_EMULATOR)
_ON_TCP = (TrackerKind.NDI_TCP, TrackerKind.IGTL)


@dataclass(frozen=True, slots=True)
class TrackerUri:
    """A parsed tracker URI."""

    kind: TrackerKind
    address: str = ""
    """Serial port, HOST:PORT, camera number or file."""

    def __str__(self) -> str:
        separator = "://" if self.kind in _ON_TCP else ":"
        return f"{self.kind.value}{separator}{self.address}"

    @property
    def in_process(self) -> bool:
        """Whether it needs nothing outside this process and no real time."""
        return self.kind in (*_WITHOUT_ADDRESS, TrackerKind.REPLAY)

    @property
    def is_simulated(self) -> bool:
        """Whether it sees the twin, whose true position is known."""
        return self.kind in _WITHOUT_ADDRESS

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Of a tracker on TCP."""
        host, _, port = self.address.rpartition(":")
        return host, int(port)


def parse_tracker_uri(text: str) -> TrackerUri:
    """Read a tracker URI.

    Raises:
        ConfigError: unknown form, or one that lacks its address.
    """
    scheme, colon, rest = text.partition(":")
    kinds = {kind.value: kind for kind in TrackerKind}
    if not colon or scheme not in kinds:
        raise ConfigError(f"tracker {text}: unknown form", f"use one of {KNOWN_FORMS}")
    kind = kinds[scheme]
    if kind in _WITHOUT_ADDRESS:
        if rest:
            raise ConfigError(
                f"tracker {text}: nothing may follow the colon", f"write {kind.value}:"
            )
        return TrackerUri(kind)
    address = _host_and_port(rest) if kind in _ON_TCP else rest
    if not address or (kind is TrackerKind.ARUCO and not _is_number(address)):
        raise ConfigError(f"tracker {text}: its address is wrong", f"write e.g. {_EXAMPLES[kind]}")
    return TrackerUri(kind, address)


def _host_and_port(rest: str) -> str:
    host, colon, port = rest.removeprefix("//").rpartition(":")
    right = rest.startswith("//") and colon and host and _is_number(port)
    return f"{host}:{port}" if right and 0 < int(port) <= _LAST_TCP_PORT else ""


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit()
