"""The interface of all trackers."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import index
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.core.clock import Clock
from ccr_host.core.errors import TrackerError

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Sample:
    """One exposure of all markers."""

    exposed_us: int
    """Time of exposure on the run's clock."""
    markers_mm: Array
    """(S + 1, 3): the positions of M1 (base) and of a marker at the end of every segment, one per
    row. A marker that is neither M1 nor the last one, the tip, may be lost: NaN."""

    @property
    def tip_mm(self) -> Array:
        """(3,): f_m of the paper, the last marker relative to M1."""
        tip: Array = self.markers_mm[-1] - self.markers_mm[0]
        return tip

    @property
    def ends_mm(self) -> Array:
        """(S, 3): the ends of the segments relative to M1, of which the last one is the tip."""
        ends: Array = self.markers_mm[1:] - self.markers_mm[0]
        return ends


_FARTHEST_MM = 1e6
"""Coordinate beyond the volume of any camera."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a rigid body is, in the camera's frame."""

    position_mm: Array
    """(3,): origin of the body."""
    quaternion: Array
    """(4,): w, x, y, z; turns vectors of the body into the camera's frame."""
    error_mm: float = 0.0
    """RMS misfit of the body's markers as reported by the device; 0 if it reports none."""

    @classmethod
    def of(cls, position_mm: Array, turn: Rotation) -> Pose:
        """A pose whose device reports no misfit."""
        return cls(position_mm, turn.as_quat(canonical=True, scalar_first=True))


@dataclass(frozen=True, eq=False)
class MarkerFrame:
    """One exposure: single markers that are not labelled yet, and bodies with a name."""

    exposed_us: int
    """Best estimate of the time of exposure on the run's clock."""
    frame_number: int
    """Frame number of the device since it was last started."""
    points_mm: Array
    """(n, 3): single markers in the camera's frame, one per row, in any order."""
    out_of_volume: BoolArray
    """(n,): whether a point is outside the volume in which the camera is accurate."""
    tools: Mapping[str, Pose] = field(default_factory=dict)
    """Bodies seen, by name; those not seen are absent."""


def checked_frame(frame: object) -> MarkerFrame:
    """Validate a frame of a plug-in and convert its numbers to arrays.

    What is nowhere (NaN, infinite, or beyond any camera's volume) counts as not seen.

    Raises:
        ValueError, TypeError: not a frame, or numbers of the wrong type or shape.
    """
    if not isinstance(frame, MarkerFrame):
        raise ValueError(f"{type(frame).__name__} instead of a MarkerFrame")
    points_mm = _real(frame.points_mm)
    out_of_volume = np.asarray(frame.out_of_volume, dtype=np.bool_)
    if points_mm.shape != (out_of_volume.size, 3) or out_of_volume.ndim != 1:
        shapes = f"{points_mm.shape} and {out_of_volume.shape}"
        raise ValueError(f"points_mm and out_of_volume of shapes {shapes}")
    somewhere = (np.abs(points_mm) < _FARTHEST_MM).all(axis=1)
    poses = {name: _checked_pose(name, pose) for name, pose in frame.tools.items()}
    return MarkerFrame(
        exposed_us=index(frame.exposed_us),
        frame_number=index(frame.frame_number),
        points_mm=points_mm[somewhere],
        out_of_volume=out_of_volume[somewhere],
        tools={
            name: pose
            for name, pose in poses.items()
            if (np.abs(pose.position_mm) < _FARTHEST_MM).all()
        },
    )


def _real(numbers: object) -> Array:
    """Unlike numpy's conversion, refuses complex numbers."""
    return np.asarray(numbers).astype(np.float64, casting="same_kind")


def _checked_pose(name: str, pose: Pose) -> Pose:
    position_mm = _real(pose.position_mm)
    quaternion = _real(pose.quaternion)
    if (position_mm.shape, quaternion.shape) != ((3,), (4,)):
        shapes = f"{position_mm.shape} and {quaternion.shape}"
        raise ValueError(f"{name}: position_mm and quaternion of shapes {shapes}")
    return Pose(position_mm, quaternion, float(pose.error_mm))


@dataclass(frozen=True)
class TrackerHealth:
    """State of a camera, for users."""

    state: str
    """What the driver is doing, e.g. `tracking`."""
    tracking: bool = False
    """Whether frames can be expected."""
    rate_hz: float = 0.0
    """Rate of new frames over about the last second."""
    frames: int = 0
    """New frames so far."""
    lost_frames: int = 0
    """Exposures that are missing by the frame numbers."""
    damaged_replies: int = 0
    """Answers rejected by their check sum or their grammar."""
    reconnections: int = 0
    """How often contact was lost and regained."""
    odd_frame_numbers: int = 0
    """How often a frame number did not follow the one before: damage, or a counter that changed."""
    warnings: tuple[str, ...] = ()
    """Present warnings of the device, one readable line each."""
    last_error: str = ""
    """Cause and cure of the last failure; empty if there was none."""


_WINDOW = 128
"""Long enough to contain an arrival without delay, short enough for the drift of two quartzes: 6 s
at 20 Hz, 0.6 ms at 100 ppm."""


class ClockFit:
    """Relates the device's clock to the host's by the least delay over a window.

    Everything between the two only adds delay, so the least delay is the best estimate. Arrivals
    are added one at a time between ticks of the clock, hence no filter over an array.
    """

    def __init__(self) -> None:
        self._offsets_us: deque[int] = deque(maxlen=_WINDOW)

    def see(self, device_us: int, seen_us: int) -> None:
        """Add an arrival, stamped `device_us` by the device, at `seen_us` of the run's clock."""
        self._offsets_us.append(seen_us - device_us)

    def host_us(self, device_us: int) -> int:
        """Convert a device time to the run's clock; needs at least one arrival."""
        return min(self._offsets_us) + device_us


_RATE_FRAMES = 20


class FrameCount:
    """Keeps the newest frame, ensures that frames never go back, and measures their rate."""

    def __init__(self) -> None:
        self.newest: MarkerFrame | None = None
        self.count = 0
        self._exposures_us: deque[int] = deque(maxlen=_RATE_FRAMES)

    @property
    def rate_hz(self) -> float:
        """Rate of the last frames, Hz."""
        times_us = self._exposures_us
        if len(times_us) < 2:  # noqa: PLR2004 - a rate needs an interval
            return 0.0
        return (len(times_us) - 1) * 1e6 / (times_us[-1] - times_us[0])

    def not_before_last(self, exposed_us: int) -> int:
        """An estimated time of exposure, raised if necessary to be later than the last one."""
        return exposed_us if self.newest is None else max(exposed_us, self.newest.exposed_us + 1)

    def add(self, frame: MarkerFrame) -> None:
        self.newest = frame
        self.count += 1
        self._exposures_us.append(frame.exposed_us)

    def add_poses(
        self, exposed_us: int, tools: Mapping[str, Pose], points_mm: Array | None = None
    ) -> None:
        """Add a new frame of a camera without frame numbers and volume."""
        points = np.zeros((0, 3)) if points_mm is None else points_mm
        self.add(
            MarkerFrame(
                exposed_us=self.not_before_last(exposed_us),
                frame_number=self.count + 1,
                points_mm=points,
                out_of_volume=np.zeros(len(points), dtype=bool),
                tools=dict(tools),
            )
        )


class ForeignPeerError(TrackerError):
    """The peer that answers is not the tracker that was expected."""


class RawTracker(Protocol):
    """A camera. Its owner attaches it to the run's clock, which calls `advance_to`.

    A new frame has a later exposure than the one before. A camera that loses contact reconnects
    by itself.
    """

    def start(self) -> None:
        """Open the device; frames follow as the clock advances.

        Raises:
            TrackerError: there is no such device.
        """

    def advance_to(self, time_us: int) -> None:
        """Process what has arrived by a time and continue the protocol; never waits.

        Raises:
            ForeignPeerError: there was no frame yet, and the peer is not such a tracker.
        """

    def newest_frame(self) -> MarkerFrame | None:
        """Newest frame, whatever its age: the same one until there is a newer; None at first."""

    def stop(self) -> None:
        """Leave the device in a safe state and close it; a second call has no effect."""


class NamedTracker(RawTracker, Protocol):
    """A camera with a name and a state."""

    name: str

    @property
    def health(self) -> TrackerHealth:
        """Present state of the tracker."""


class Tracker(Protocol):
    """Source of marker positions; samples never go back in time."""

    name: str

    def newest(self) -> Sample | None:
        """Newest sample that has arrived, whatever its age; None before the first."""

    def trouble(self) -> str:
        """Why there may be no newer sample, for users; empty if unknown."""


class WatchedTracker(Tracker, Protocol):
    """A tracker that also reports its health."""

    @property
    def health(self) -> TrackerHealth:
        """Health of the camera."""


DEFAULT_TIMEOUT_US = 20_000_000
"""A Polaris takes up to 7 s for a reset, and twice that if it misses the break."""
_MOST_RECONNECTIONS = 4
"""A peer that keeps closing the connection is not a camera."""
_LOOK_US = 10_000


def wait_until_tracking(
    tracker: NamedTracker, clock: Clock, timeout_us: int = DEFAULT_TIMEOUT_US
) -> None:
    """Let the clock run until the first frame is there; the tracker is attached to the clock.

    Raises:
        TrackerError: no frame in time; states what the driver was doing and its last failure.
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
