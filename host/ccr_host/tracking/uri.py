"""Tracker URIs, parsed without loading the trackers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from ccr_host.core.addresses import Role, host_and_port, split_uri, tcp_address
from ccr_host.core.errors import ConfigError
from ccr_host.core.plugins import is_class, plugin, plugin_names

_MOST_CAMERAS = 100
_CLASS_AND_ADDRESS = re.compile(r"(?P<plugin>.+?\.py:\w+):(?P<address>.*)", re.IGNORECASE)


class TrackerKind(Enum):
    """How positions are measured."""

    TWIN = "twin"
    NDI_EMULATOR = "ndi-emulator"
    NDI_SERIAL = "ndi"
    NDI_TCP = "ndi+tcp"
    IGTL = "igtl"
    ARUCO = "aruco"
    REPLAY = "replay"
    OWN = "own"
    """A plug-in."""


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
    plugin: str = ""
    """Name of the plug-in, see `ccr_host.core.plugins`."""

    def __str__(self) -> str:
        if self.kind is TrackerKind.OWN:
            has_colon = self.address or not is_class(self.plugin)
            return f"{self.plugin}:{self.address}" if has_colon else self.plugin
        separator = "://" if self.kind in _ON_TCP else ":"
        return f"{self.kind.value}{separator}{self.address}"

    @property
    def in_process(self) -> bool:
        """Whether it needs nothing outside this process and no real time.

        Raises:
            ConfigError, CodeError: the plug-in cannot be loaded.
        """
        if self.kind is TrackerKind.OWN:
            return _needs_no_real_time(self._own_class)
        return self.kind is TrackerKind.REPLAY or self.is_simulated

    @property
    def is_simulated(self) -> bool:
        """Whether it sees a simulated robot, whose true position is known.

        Raises:
            ConfigError, CodeError: the plug-in cannot be loaded.
        """
        if self.kind is TrackerKind.OWN:
            return _sees_simulated_robot(self._own_class)
        return self.kind in _WITHOUT_ADDRESS

    def check_made(self, camera: object) -> None:
        """Check that a plug-in is of the kind that its class has shown.

        Log and clock are chosen by the class, before the object is made.

        Raises:
            ConfigError: only the object shows that no real time is needed.
        """
        if self.kind is not TrackerKind.OWN:
            return
        for trait in (_sees_simulated_robot, _needs_no_real_time):
            if trait(camera) != trait(self._own_class):
                made = type(camera).__name__
                raise ConfigError(
                    f"tracker {self}: only the finished {made} has `expose` or `in_process`",
                    f"pass a class that has them, not a function; derive it from {made} to give "
                    "other arguments",
                )

    @property
    def _own_class(self) -> object:
        return plugin("tracker", self.plugin)

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Host and port of a tracker on TCP."""
        return host_and_port(self.address, f"tracker {self}", _EXAMPLES[self.kind])


def parse_tracker_uri(text: str) -> TrackerUri:
    """Read a tracker URI.

    Raises:
        ConfigError: unknown form, or one that lacks its address.
    """
    if in_file := _CLASS_AND_ADDRESS.fullmatch(text):
        return TrackerUri(TrackerKind.OWN, in_file["address"], in_file["plugin"])
    if is_class(text):
        return TrackerUri(TrackerKind.OWN, plugin=text)
    try:
        scheme, rest = split_uri(Role.TRACKER, text)
    except ConfigError:
        name, colon, address = text.partition(":")
        if colon and name in plugin_names("tracker"):
            return TrackerUri(TrackerKind.OWN, address, name)
        raise
    kind = TrackerKind(scheme)
    if kind in _WITHOUT_ADDRESS:
        return TrackerUri(kind)
    example = _EXAMPLES[kind]
    if not rest:
        raise ConfigError(f"tracker {text}: the address is missing", f"write e.g. {example}")
    if kind in _ON_TCP:
        return TrackerUri(kind, tcp_address(rest, f"tracker {text}", example))
    if kind is TrackerKind.ARUCO and not _is_camera_number(rest):
        number = rest.removeprefix("/dev/video")
        meant = f"aruco:{number}" if _is_camera_number(number) else f"e.g. {example}"
        raise ConfigError(f"tracker {text}: not the number of a camera", f"write {meant}")
    return TrackerUri(kind, rest)


def _sees_simulated_robot(camera: object) -> bool:
    """Whether a plug-in's class or object is a simulated camera."""
    return hasattr(camera, "expose")


def _needs_no_real_time(camera: object) -> bool:
    return _sees_simulated_robot(camera) or bool(getattr(camera, "in_process", False))


def _is_camera_number(text: str) -> bool:
    is_short = text.isascii() and text.isdigit() and len(text) < len(str(_MOST_CAMERAS))
    return is_short and int(text) < _MOST_CAMERAS
