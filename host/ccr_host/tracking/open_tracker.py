"""Makes the tracker that a URI names, where that is outside this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from ccr_host.core.addresses import Role, host_and_port, split_uri, tcp_address
from ccr_host.core.clock import Clock
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.core.plugins import is_class, make_plugin, plugin, plugin_names
from ccr_host.description.schema import Description, Tracker
from ccr_host.tracking.sources.aruco import (
    ArucoSettings,
    ArucoTracker,
    TagDetector,
    Webcam,
    load_camera_file,
)
from ccr_host.tracking.sources.igtl import IgtlTracker
from ccr_host.tracking.sources.ndi.driver import NdiSettings, NdiTracker
from ccr_host.tracking.sources.ndi.port import SerialPort, tcp_opener
from ccr_host.tracking.sources.ndi.session import Tool
from ccr_host.tracking.tracker import RawTracker

_MOST_CAMERAS = 100


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
    """By a plug-in."""


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
            return self.plugin if is_class(self.plugin) else f"{self.plugin}:{self.address}"
        separator = "://" if self.kind in _ON_TCP else ":"
        return f"{self.kind.value}{separator}{self.address}"

    @property
    def in_process(self) -> bool:
        """Whether it needs nothing outside this process and no real time.

        Raises:
            ConfigError, CodeError: the plug-in cannot be loaded.
        """
        if self.kind is TrackerKind.OWN and getattr(self._own_class, "in_process", False):
            return True
        return self.kind is TrackerKind.REPLAY or self.is_simulated

    @property
    def is_simulated(self) -> bool:
        """Whether it sees a simulated robot, whose true position is known.

        Raises:
            ConfigError, CodeError: the plug-in cannot be loaded.
        """
        if self.kind is TrackerKind.OWN:
            return hasattr(self._own_class, "expose")
        return self.kind in _WITHOUT_ADDRESS

    @property
    def _own_class(self) -> object:
        return plugin("tracker", self.plugin)

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Of a tracker on TCP."""
        return host_and_port(self.address, f"tracker {self}", _EXAMPLES[self.kind])


def parse_tracker_uri(text: str) -> TrackerUri:
    """Read a tracker URI.

    Raises:
        ConfigError: unknown form, or one that lacks its address.
    """
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
        if rest:
            raise ConfigError(
                f"tracker {text}: nothing may follow the colon", f"write {kind.value}:"
            )
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


def _is_camera_number(text: str) -> bool:
    is_short = text.isascii() and text.isdigit() and len(text) < len(str(_MOST_CAMERAS))
    return is_short and int(text) < _MOST_CAMERAS


DEFAULT_TIMEOUT_US = 20_000_000
"""A Polaris takes up to 7 s for a reset and as long again when its break is not heard."""
_MOST_RECONNECTIONS = 4
"""What closes the connection time after time will not become a camera by waiting."""
_LOOK_US = 10_000


def wait_until_tracking(
    tracker: RawTracker, clock: Clock, timeout_us: int = DEFAULT_TIMEOUT_US
) -> None:
    """Let the clock run until the first frame is there; the tracker is attached to the clock.

    Raises:
        TrackerError: no frame in time; tells what the driver was doing and its last failure.
    """
    start_us = clock.now_us()
    while tracker.newest_frame() is None:
        health, waited_us = tracker.health, clock.now_us() - start_us
        if waited_us >= timeout_us or health.reconnections >= _MOST_RECONNECTIONS:
            told = "; ".join([f"still {health.state}", *health.warnings])
            raise TrackerError(
                f"{tracker.name}: no frame within {waited_us / 1e6:.0f} s, {told}",
                health.last_error or "check power and cable of the camera",
            )
        clock.sleep_until_us(clock.now_us() + _LOOK_US)


def open_tracker(
    uri: TrackerUri, description: Description, tools: Sequence[Tool] = ()
) -> RawTracker:
    """Make a tracker; it is not started yet.

    Args:
        uri: anything but `twin:` and `ndi-emulator:`, which need a scene.
        description: of the robot and its tracker.
        tools: rigid bodies for a Polaris; none for single spheres.

    Raises:
        ConfigError: a package or a setting is missing.
        CodeError: the plug-in cannot be constructed.
    """
    name = str(uri)
    latency_us = round(description.tracker.latency_ms * 1000)
    settings = NdiSettings(tools=tools, latency_us=latency_us)
    match uri.kind:
        case TrackerKind.NDI_SERIAL:
            return NdiTracker(name, lambda: SerialPort(uri.address), settings)
        case TrackerKind.NDI_TCP:
            return NdiTracker(name, tcp_opener(uri.address), settings)
        case TrackerKind.IGTL:
            host, port = uri.host_and_port
            return IgtlTracker(host, port, latency_us=latency_us)
        case TrackerKind.ARUCO:
            return _aruco(uri, description.tracker, latency_us)
        case TrackerKind.REPLAY | TrackerKind.OWN:
            address = (uri.address,) if uri.address else ()
            methods = ("start", "stop", "advance_to", "newest_frame")
            made: RawTracker = make_plugin(
                "tracker", uri.plugin or "replay", methods, description, *address
            )
            return made
    raise ConfigError(f"tracker {uri}: needs the twin", "use it with an emulated board")


def _aruco(uri: TrackerUri, tracker: Tracker, latency_us: int) -> RawTracker:
    if tracker.camera_file is None or tracker.tag_size_mm is None:
        raise ConfigError(
            f"tracker {uri}: calibration or size of the tags is missing",
            "set tracker.camera_file and tracker.tag_size_mm",
        )
    camera = load_camera_file(Path(tracker.camera_file))
    detector = TagDetector(camera, ArucoSettings(tracker.tag_size_mm))
    number = int(uri.address)
    return ArucoTracker(str(uri), lambda: Webcam(number), detector, latency_us)
