"""The tracker of a rig, made from its URI."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import cast

import numpy as np
import scipy

from ccr_host.core.arrays import Array
from ccr_host.core.clock import NEVER_US, Clock
from ccr_host.core.errors import ConfigError
from ccr_host.core.plugins import Guard, make_plugin
from ccr_host.description.schema import Description
from ccr_host.sim.polaris.line import PolarisLine, faults_of, make_polaris
from ccr_host.sim.robot.plant import TWIN
from ccr_host.sim.robot.scene import ExposedCamera, TwinScene, make_plant
from ccr_host.tracking.markers.marker_tracker import BelievedAngles, MarkerTracker
from ccr_host.tracking.sources.aruco import (
    ArucoSettings,
    ArucoTracker,
    TagDetector,
    Webcam,
    tag_names,
)
from ccr_host.tracking.sources.camera_model import load_camera_file
from ccr_host.tracking.sources.igtl import IgtlTracker
from ccr_host.tracking.sources.ndi.driver import NdiSettings, NdiTracker
from ccr_host.tracking.sources.ndi.port import SerialPort, tcp_opener
from ccr_host.tracking.sources.ndi.rom import load_rom
from ccr_host.tracking.sources.ndi.session import Tool
from ccr_host.tracking.sources.twin import Camera, TwinTracker
from ccr_host.tracking.tracker import (
    MarkerFrame,
    NamedTracker,
    RawTracker,
    TrackerHealth,
    WatchedTracker,
    checked_frame,
    wait_until_tracking,
)
from ccr_host.tracking.uri import TrackerKind, TrackerUri


class TrackerRig:
    """A camera, and the simulated robot if the camera is simulated here.

    ``seed`` is that of the simulated camera's noise, ``plant`` a name for `make_plant`.

    Raises:
        ConfigError: the description lacks what the tracker needs, a package is missing, or the
            tracker cannot see the plant that was named.
        CodeError: a plug-in cannot be constructed.
    """

    def __init__(
        self,
        uri: TrackerUri,
        description: Description,
        seed: np.random.SeedSequence,
        plant: str = TWIN,
    ) -> None:
        self._description = description
        self._is_recorded = uri.kind is TrackerKind.REPLAY
        """Its samples have been through the registration."""
        self._twin_camera: Camera | None = None
        self._polaris: PolarisLine | None = None
        self.camera: NamedTracker | None = None
        """None for ``twin:``, which has no protocol."""
        self.scene: TwinScene | None = None
        """None if the robot is not simulated here."""
        match uri.kind:
            case TrackerKind.TWIN:
                self._twin_camera = Camera(description.tracker, np.random.default_rng(seed))
                exposed: ExposedCamera | None = self._twin_camera
            case TrackerKind.NDI_EMULATOR:
                faults = faults_of(description.polaris_faults, None)
                self._polaris = make_polaris(description.tracker, seed, faults=faults)
                exposed = self._polaris.device.sensor
                self.camera = NdiTracker(str(uri), self._polaris.open, _ndi_settings(description))
            case _:
                camera = open_tracker(uri, description)
                guarded = self.camera = _Guarded(camera, str(uri))
                exposed = guarded if uri.is_simulated else None
        if exposed is not None:
            self.scene = TwinScene(make_plant(plant, description), exposed)
        elif plant != TWIN:
            raise ConfigError(
                f"plant {plant}: tracker {uri} sees no simulated robot", "use it with twin:"
            )

    @contextmanager
    def running(self, clock: Clock) -> Iterator[None]:
        """Start the camera and stop it at the end; attach the scene's movers to the clock before.

        Raises:
            TrackerError: there is no such camera.
        """
        with ExitStack() as stack:
            if self._polaris is not None:
                clock.attach(self._polaris)
            if self.camera is not None:
                self.camera.start()
                stack.callback(self.camera.stop)
                clock.attach(self.camera)
            yield

    def tracker(
        self, clock: Clock, believed_rad: BelievedAngles, *, in_camera_frame: bool = False
    ) -> WatchedTracker:
        """Samples of the running camera in the robot's frame, or in the camera's own.

        A camera that was never registered is taken to be aligned with the robot.
        """
        stays = in_camera_frame or self._is_recorded
        camera_to_robot = None if stays else camera_rotation(self._description)
        if self._twin_camera is not None:
            return TwinTracker(self._twin_camera, clock, camera_to_robot)
        assert self.camera is not None
        tracker = MarkerTracker(self.camera, self._description.robot, camera_to_robot, believed_rad)
        clock.attach(tracker)
        return tracker

    def wait_until_tracking(self, clock: Clock) -> None:
        """Wait for the first frame; a camera may take seconds to start.

        Raises:
            TrackerError: no frame in time.
        """
        if self.camera is not None:
            wait_until_tracking(self.camera, clock)

    def start_path_clock(self, time_us: int) -> None:
        """Set the time from which the description's timed disturbances count."""
        if self.scene is not None:
            self.scene.start_path_clock(time_us)
        if self._polaris is not None:
            faults = faults_of(self._description.polaris_faults, time_us)
            self._polaris.device.sensor.faults = faults


def camera_rotation(description: Description) -> Array:
    """Rotation (3, 3) from the camera's frame to the robot's; the identity if not registered."""
    registration = description.registration
    if registration is None:
        return np.eye(3)
    turn = scipy.spatial.transform.Rotation.from_rotvec(
        registration.camera_to_robot_deg, degrees=True
    )
    matrix: Array = turn.as_matrix()
    return matrix


def _ndi_settings(description: Description) -> NdiSettings:
    tracker = description.tracker
    return NdiSettings(_tools(description), latency_us=round(tracker.latency_ms * 1000))


def _tools(description: Description) -> list[Tool]:
    files = description.tracker.tool_files
    tools = [Tool(name, load_rom(Path(file))) for name, file in files.items()]
    names: dict[bytes, str] = {}
    for tool in tools:
        other = names.setdefault(tool.rom, tool.name)
        if other != tool.name:
            raise ConfigError(
                f"tracker.tool_files: {other} and {tool.name} have the same tool definition",
                "give each marker the .rom of its own tool",
            )
    return tools


class _Guarded:
    """A camera that may be a plug-in, whose failures are reported as such."""

    def __init__(self, camera: RawTracker, name: str) -> None:
        self.name = name
        self._camera = camera
        self._exposed = cast(ExposedCamera, camera)  # only used if it is one
        self._answer: object = None
        self._frame: MarkerFrame | None = None
        self._guard = Guard(f"{name}: {type(camera).__name__}", "tracker")

    @property
    def health(self) -> TrackerHealth:
        with self._guard.blamed("health"):
            health = getattr(self._camera, "health", TrackerHealth("running", tracking=True))
            if not isinstance(health, TrackerHealth):
                raise TypeError(f"{type(health).__name__} instead of a TrackerHealth")
            return health

    def start(self) -> None:
        with self._guard.blamed("start"):
            self._camera.start()

    def stop(self) -> None:
        with self._guard.blamed("stop"):
            self._camera.stop()

    def advance_to(self, time_us: int) -> None:
        if not self._guard.has_failed:
            with self._guard.blamed("advance_to"):
                self._camera.advance_to(time_us)

    @property
    def next_exposure_us(self) -> int:
        """Next exposure of a simulated camera; there are none after a failure."""
        if self._guard.has_failed:
            return NEVER_US
        with self._guard.blamed("next_exposure_us"):
            return self._exposed.next_exposure_us

    def expose(self, time_us: int, markers_mm: Array) -> None:
        with self._guard.blamed("expose"):
            self._exposed.expose(time_us, markers_mm)
            if self._exposed.next_exposure_us <= time_us:
                raise ValueError("next_exposure_us has not moved on")

    def newest_frame(self) -> MarkerFrame | None:
        if not self._guard.has_failed:
            with self._guard.blamed("newest_frame"):
                answer = self._camera.newest_frame()
                if answer is not self._answer:
                    self._frame = None if answer is None else checked_frame(answer)
                self._answer = answer
        return self._frame


def open_tracker(uri: TrackerUri, description: Description) -> RawTracker:
    """Make a tracker; it is not started yet.

    Those of `twin:` and `ndi-emulator:` need a scene and are made elsewhere.

    Raises:
        ConfigError: a package or a setting is missing.
        CodeError: the plug-in cannot be constructed.
    """
    name = str(uri)
    latency_us = round(description.tracker.latency_ms * 1000)
    settings = _ndi_settings(description)
    match uri.kind:
        case TrackerKind.NDI_SERIAL:
            return NdiTracker(name, lambda: SerialPort(uri.address), settings)
        case TrackerKind.NDI_TCP:
            return NdiTracker(name, tcp_opener(uri.address), settings)
        case TrackerKind.IGTL:
            host, port = uri.host_and_port
            markers = description.robot.markers
            return IgtlTracker(host, port, expected_tools=markers, latency_us=latency_us)
        case TrackerKind.ARUCO:
            return _aruco(uri, description, latency_us)
        case TrackerKind.REPLAY | TrackerKind.OWN:
            address = (uri.address,) if uri.address else ()
            methods = ("start", "stop", "advance_to", "newest_frame")
            made: RawTracker = make_plugin(
                "tracker", uri.plugin or "replay", methods, description, *address
            )
            uri.check_made(made)
            return made
    raise ConfigError(f"tracker {uri}: needs the twin", "use it with an emulated board")


def _aruco(uri: TrackerUri, description: Description, latency_us: int) -> RawTracker:
    tracker = description.tracker
    if tracker.camera_file is None or tracker.tag_size_mm is None:
        raise ConfigError(
            f"tracker {uri}: calibration or size of the tags is missing",
            "set tracker.camera_file and tracker.tag_size_mm",
        )
    camera = load_camera_file(Path(tracker.camera_file))
    tags = tag_names(description.robot.markers)
    detector = TagDetector(camera, ArucoSettings(tracker.tag_size_mm, tags=tags))
    number = int(uri.address)
    return ArucoTracker(str(uri), lambda: Webcam(number), detector, latency_us)
