"""The optics: exposes the scene and delivers the image after a latency, and the camera's faults.

Has the interface of the twin's camera, so that a twin's scene exposes it at exact times.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
import scipy

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.description.simulation import Tracker
from ccr_host.tracking.sources.twin import Shutter

Span = tuple[int, int]


class BitOrder(Enum):
    """Which end of the out-of-volume bits is the first stray; open-source parsers differ."""

    FIRST_IS_HIGHEST = "first is highest"
    FIRST_IS_LOWEST = "first is lowest"


@dataclass(frozen=True)
class PolarisFaults:
    """Injected faults, by default none.

    Probabilities are per exposure or reply; intervals and times are in the run's clock.
    """

    shuffle: bool = False
    """Report strays in random order."""
    phantoms: int = 0
    """Number of false points per frame."""
    occlusion: float = 0.0
    """Probability that a marker is hidden in an exposure."""
    occluded_us: tuple[Span, ...] = ()
    """Intervals in which all markers are hidden."""
    frozen: float = 0.0
    """Probability that an exposure is skipped, besides `tracker.dropout`: the frame is repeated."""
    out_of_volume: bool = False
    """Move the scene beyond the far end of the measurement volume."""
    out_of_volume_us: tuple[Span, ...] = ()
    """Intervals in which the scene is beyond the far end of the measurement volume."""
    bad_crc: float = 0.0
    """Probability that a byte of a reply is changed in transit."""
    silent_us: tuple[Span, ...] = ()
    """Intervals in which commands are ignored."""
    unplugged_us: tuple[Span, ...] = ()
    """Intervals in which the host's port is gone."""
    resets_us: tuple[int, ...] = ()
    """Times at which the power fails for a moment."""
    too_hot: bool = False
    """Set the status bit for a temperature outside the operating range."""
    diagnostic_pending: bool = False
    """Set the status bit for a bump or another diagnostic."""
    comm_refused: bool = False
    """Answer COMM with ERROR06 and keep the bit rate."""
    wrong_frames_us: tuple[Span, ...] = ()
    """Intervals in which the frame numbers in replies are far too high."""
    pinit_warning: bool = False
    """Answer PINIT with WARNING05 instead of OKAY."""
    bit_order: BitOrder = BitOrder.FIRST_IS_HIGHEST


NO_FAULTS = PolarisFaults()


def is_within(time_us: int, spans: tuple[Span, ...]) -> bool:
    """Whether a time lies in one of the intervals [start, end)."""
    return any(start <= time_us < end for start, end in spans)


Vector3 = tuple[float, float, float]

IN_FRONT_MM: Vector3 = (0.0, 50.0, -900.0)
"""Places a robot of 100 mm that hangs along -y in the middle of a Vicra's volume."""


@dataclass(frozen=True)
class Placement:
    """Pose of a camera: with rotation R relative to the robot frame it measures R^T p + t."""

    rotation_deg: Vector3 = (0.0, 0.0, 0.0)
    """Rotation vector of R."""
    base_mm: Vector3 = IN_FRONT_MM
    """t: origin of the robot frame in the camera frame."""

    @cached_property
    def turn(self) -> scipy.spatial.transform.Rotation:
        """R^T."""
        return scipy.spatial.transform.Rotation.from_rotvec(self.rotation_deg, degrees=True).inv()

    def quaternion(self) -> Array:
        """Quaternion (w, x, y, z) of R^T, (4,)."""
        quaternion: Array = self.turn.as_quat(canonical=True, scalar_first=True)
        return quaternion

    def to_camera(self, points_mm: Array) -> Array:
        """Transform points, mm, (n, 3), from the robot frame to the camera frame."""
        placed: Array = self.turn.apply(points_mm) + np.array(self.base_mm)
        return placed


COUNTER_HZ = 60
COUNTS_PER_EXPOSURE = 3
"""A Vicra delivers 20 frames per second; its frame counter runs at 60 Hz."""

_BEYOND_FAR_END_MM = (0.0, 0.0, -700.0)
_PHANTOM_SPREAD_MM = 150.0
_DETECTION_DEPTH_MM = 3000.0
"""Nothing is detected further away than this, in the volume or not."""


@dataclass(frozen=True, eq=False)
class Image:
    """Result of one exposure."""

    count: int
    """60 Hz counter since power-up."""
    markers_mm: Array
    """Measured positions in the camera frame, (n, 3); row i is marker i."""
    visible: BoolArray
    """Whether each marker is visible, (n,)."""
    phantoms_mm: Array
    """False points in the camera frame, (m, 3)."""
    ranks: Array
    """Sort keys that define the order in which strays are reported, (n + m,)."""
    quaternion: Array
    """Orientation of the robot frame, for tools, (4,)."""


class PositionSensor:
    """Exposes at 20 Hz whatever the device does; nothing is visible without illumination.

    Exposures follow one another whatever the rate of ``tracker``, that section of the description.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        tracker: Tracker,
        *,
        placement: Placement | None = None,
        faults: PolarisFaults = NO_FAULTS,
    ) -> None:
        self._rng = rng
        self._placement = placement or Placement(rotation_deg=tracker.rotation_deg)
        self._noise_per_coordinate_mm = tracker.noise_mm / math.sqrt(6)
        self._dropout = tracker.dropout
        self._latency_us = round(tracker.latency_ms * 1000)
        self._shutter = Shutter(tracker, COUNTER_HZ / COUNTS_PER_EXPOSURE, rng)
        self.faults = faults
        self.illuminated = False
        """Set by the device; a dark exposure shows no passive marker."""
        self._exposures = 0
        self._in_flight: deque[tuple[int, Image]] = deque()
        self._newest: Image | None = None

    @property
    def next_exposure_us(self) -> int:
        return self._shutter.next_look_us

    def expose(self, time_us: int, markers_mm: Array) -> None:
        stated_us = self._shutter.stated_us
        picture_mm = self._shutter.look(markers_mm)
        if picture_mm is None:
            return
        count = self._exposures * COUNTS_PER_EXPOSURE
        self._exposures += 1
        image = self._picture(count, time_us, picture_mm)
        if self._rng.random() >= 1.0 - (1.0 - self.faults.frozen) * (1.0 - self._dropout):
            self._in_flight.append((stated_us + self._latency_us, image))

    def newest(self, time_us: int) -> Image | None:
        """Latest image available at `time_us`, which must not decrease between calls."""
        while self._in_flight and self._in_flight[0][0] <= time_us:
            self._newest = self._in_flight.popleft()[1]
        return self._newest

    def _picture(self, count: int, time_us: int, markers_mm: Array) -> Image:
        rng, faults = self._rng, self.faults
        noise_mm = self._noise_per_coordinate_mm * rng.standard_normal(markers_mm.shape)
        hidden = rng.random(len(markers_mm)) < faults.occlusion
        measured_mm = self._placement.to_camera(markers_mm) + noise_mm
        if faults.out_of_volume or is_within(time_us, faults.out_of_volume_us):
            measured_mm = measured_mm + np.array(_BEYOND_FAR_END_MM)
        seen = self.illuminated & ~hidden & (measured_mm[:, 2] > -_DETECTION_DEPTH_MM)
        if is_within(time_us, faults.occluded_us):
            seen &= False
        spread_mm = rng.uniform(-1, 1, (faults.phantoms, 3)) * _PHANTOM_SPREAD_MM
        phantoms_mm = measured_mm.mean(axis=0) + spread_mm
        ranks = np.arange(len(markers_mm) + faults.phantoms, dtype=np.float64)
        if faults.shuffle:
            ranks = rng.permutation(ranks)
        return Image(
            count=count,
            markers_mm=measured_mm,
            visible=seen,
            phantoms_mm=phantoms_mm if self.illuminated else phantoms_mm[:0],
            ranks=ranks,
            quaternion=self._placement.quaternion(),
        )


TRANSFORMS = 0x0001
OUTSIDE_VOLUME_TOO = 0x0800
PASSIVE_STRAYS = 0x1000
SUPPORTED_MODE = TRANSFORMS | OUTSIDE_VOLUME_TOO | PASSIVE_STRAYS

MAX_STRAYS = 50
_PORT_OUT_OF_VOLUME = 0x40


@dataclass(frozen=True, eq=False)
class ToolLine:
    """A tool in a frame; it is missing if it has no position."""

    handle: int
    status: int
    frame: int
    position_mm: Array | None = None
    quaternion: Array | None = None
    in_volume: bool = True


@dataclass(frozen=True, eq=False)
class StrayList:
    """Stray markers of a frame, (n, 3), and whether each is in the volume, (n,)."""

    positions_mm: Array
    in_volume: BoolArray


def format_tx(
    mode: int,
    tools: Sequence[ToolLine],
    strays: StrayList,
    system_status: int,
    bit_order: BitOrder,
) -> str:
    """Payload of the TX reply for a reply mode."""
    parts = [f"{len(tools):02X}"]
    parts += [_tool(tool, mode) for tool in tools]
    if mode & PASSIVE_STRAYS:
        parts.append(_strays(strays, bool(mode & OUTSIDE_VOLUME_TOO), bit_order))
    parts.append(f"{system_status:04X}")
    return "".join(parts)


def _tool(tool: ToolLine, mode: int) -> str:
    text = f"{tool.handle:02X}"
    if mode & TRANSFORMS:
        status = tool.status
        hidden = not (tool.in_volume or mode & OUTSIDE_VOLUME_TOO)
        if tool.position_mm is None or tool.quaternion is None:
            text += "MISSING"
        else:
            status |= _PORT_OUT_OF_VOLUME * (not tool.in_volume)
            text += "MISSING" if hidden else _transform(tool.quaternion, tool.position_mm)
        text += f"{status:08X}{tool.frame:08X}"
    return text + "\n"


def _transform(quaternion: Array, position_mm: Array) -> str:
    ratios = "".join(f"{round(float(q) * 10_000):+06d}" for q in quaternion)
    return ratios + _position(position_mm) + "+00900"


def _strays(strays: StrayList, outside_too: bool, bit_order: BitOrder) -> str:
    shown = np.ones(len(strays.in_volume), dtype=bool) if outside_too else strays.in_volume
    outside = ~strays.in_volume[shown][:MAX_STRAYS]
    positions_mm = strays.positions_mm[shown][:MAX_STRAYS]
    digits = -(-len(outside) // 4)
    ordered = outside if bit_order is BitOrder.FIRST_IS_HIGHEST else outside[::-1]
    bits = int("".join("1" if bit else "0" for bit in ordered) or "0", 2)
    text = f"{len(outside):02X}" + (f"{bits:0{digits}X}" if digits else "")
    return text + "".join(_position(position_mm) for position_mm in positions_mm)


def _position(position_mm: Array) -> str:
    return "".join(f"{round(float(value) * 100):+07d}" for value in position_mm)
