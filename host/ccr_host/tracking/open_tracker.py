"""Makes the tracker that a URI names, where that is outside this process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ccr_host.errors import ConfigError
from ccr_host.tracking.aruco import (
    ArucoSettings,
    ArucoTracker,
    TagDetector,
    Webcam,
    load_camera_file,
)
from ccr_host.tracking.frame import RawTracker
from ccr_host.tracking.igtl import IgtlTracker
from ccr_host.tracking.ndi.driver import NdiSettings, NdiTracker
from ccr_host.tracking.ndi.port import SerialPort, tcp_opener
from ccr_host.tracking.ndi.session import Tool
from ccr_host.tracking.replay import ReplayTracker
from ccr_host.tracking.uri import TrackerKind, TrackerUri


def open_tracker(
    uri: TrackerUri,
    *,
    latency_us: int,
    tools: Sequence[Tool] = (),
    camera_file: Path | None = None,
    tag_size_mm: float | None = None,
) -> RawTracker:
    """Make a tracker; it is not started yet.

    Args:
        uri: anything but `twin:` and `ndi-emulator:`, which need a scene.
        latency_us: from an exposure to the earliest time at which the host could have it.
        tools: rigid bodies for a Polaris; none for single spheres.
        camera_file: calibration of a webcam.
        tag_size_mm: edge of the tags under a webcam.

    Raises:
        ConfigError: a package or a setting is missing.
    """
    name = str(uri)
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
            return _aruco(uri, camera_file, tag_size_mm, latency_us)
        case TrackerKind.REPLAY:
            return ReplayTracker(Path(uri.address), latency_us)
    raise ConfigError(f"tracker {uri}: needs the twin", "use it with an emulated board")


def _aruco(
    uri: TrackerUri, camera_file: Path | None, tag_size_mm: float | None, latency_us: int
) -> RawTracker:
    if camera_file is None or tag_size_mm is None:
        raise ConfigError(
            f"tracker {uri}: calibration or size of the tags is missing",
            "set tracker.camera_file and tracker.tag_size_mm",
        )
    detector = TagDetector(load_camera_file(camera_file), ArucoSettings(tag_size_mm))
    number = int(uri.address)
    return ArucoTracker(str(uri), lambda: Webcam(number), detector, latency_us)
