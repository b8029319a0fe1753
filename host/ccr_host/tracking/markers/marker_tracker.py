"""Converts a camera's frames to samples: labelling, then registration."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.clock import NEVER_US
from ccr_host.description.schema import Robot
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.tracking.markers.labelling import Labeller
from ccr_host.tracking.tracker import MarkerFrame, NamedTracker, Sample, TrackerHealth

BelievedAngles = Callable[[], Array]
"""Returns the believed motor angles at present, rad, (n,)."""


class MarkerTracker:
    """Processes every new frame of a camera; a frame that shows the tip becomes a sample.

    Attach it to the clock after the camera and what changes the belief. Bodies named M1, M2 and so
    on are used as the markers; if the camera names none of them, its points are labelled. Points
    outside its volume are not used. All markers of a sample but M1 and the tip may be lost (NaN).
    ``camera_to_robot`` is as for `Labeller`; without it samples stay in the camera's frame.
    ``believed_rad`` is constant between the turns of other parts and the calls of the host.
    """

    def __init__(
        self,
        camera: NamedTracker,
        geometry: Robot,
        camera_to_robot: Array | None,
        believed_rad: BelievedAngles,
    ) -> None:
        self.name = camera.name
        self._camera = camera
        self._camera_to_robot = camera_to_robot
        self._markers = geometry.markers
        self._labeller = Labeller(geometry, camera_to_robot)
        self._believed_rad = believed_rad
        self._beliefs = SetpointHistory(believed_rad())
        """The motor angles that were believed when an older frame was exposed."""
        self._names_markers = False
        self._frame: MarkerFrame | None = None
        self._lost = geometry.markers
        self._sample: Sample | None = None

    @property
    def health(self) -> TrackerHealth:
        return self._camera.health

    @property
    def frame(self) -> MarkerFrame | None:
        """The newest frame, complete."""
        return self._frame

    @property
    def lost(self) -> tuple[str, ...]:
        """Markers that the newest frame does not show with certainty."""
        return self._lost

    def advance_to(self, time_us: int) -> None:
        if (believed_rad := self._new_belief()) is not None:
            self._beliefs.command(time_us * 1e-6, believed_rad, 0.0)
        if (frame := self._new_frame()) is None:
            return
        self._frame = frame
        markers_mm = self._markers_mm(frame)
        gone = np.isnan(markers_mm[:, 0])
        self._lost = tuple(
            name for name, is_gone in zip(self._markers, gone, strict=True) if is_gone
        )
        if not (gone[0] or gone[-1]):
            if self._camera_to_robot is not None:
                markers_mm = markers_mm @ self._camera_to_robot.T
            self._sample = Sample(frame.exposed_us, markers_mm)

    @property
    def next_turn_us(self) -> int:
        """0, which is past, if there is something new; what comes, others see coming."""
        is_news = self._new_belief() is not None or self._new_frame() is not None
        return 0 if is_news else NEVER_US

    next_arrival_us = next_turn_us
    """A new sample appears in such a turn, or in that of the camera."""

    def newest(self) -> Sample | None:
        return self._sample

    def trouble(self) -> str:
        health, frame = self.health, self._frame
        told = list(health.warnings)
        if not health.tracking or frame is None:
            told = [f"camera: {health.state}", health.last_error, *told]
        elif self._lost:
            seen, outside = len(frame.points_mm) + len(frame.tools), int(frame.out_of_volume.sum())
            told.append(
                f"of {', '.join(self._markers)} the newest frame lacks {', '.join(self._lost)}"
            )
            told.append(f"it shows {seen} markers and tools")
            if outside:
                told.append(f"{outside} of them outside the camera's volume")
            unnamed = len(frame.points_mm) - outside
            if unnamed >= len(self._markers) and not self._names_markers:
                told.append("if they are the robot's, find out how the camera stands: register")
        return "; ".join(text for text in told if text)

    def _new_belief(self) -> Array | None:
        """The present belief if it is not the last one that was noted."""
        believed_rad, noted_rad = self._believed_rad(), self._beliefs.at(math.inf)
        is_noted = believed_rad is noted_rad or np.array_equal(believed_rad, noted_rad)
        return None if is_noted else believed_rad

    def _new_frame(self) -> MarkerFrame | None:
        """The camera's newest frame if it is not yet processed."""
        frame, last = self._camera.newest_frame(), self._frame
        is_old = frame is None or (last is not None and frame.exposed_us <= last.exposed_us)
        return None if is_old else frame

    def _markers_mm(self, frame: MarkerFrame) -> Array:
        """The markers, (S + 1, 3), in the camera's frame; NaN if lost."""
        markers = self._markers
        named = {name: pose for name, pose in frame.tools.items() if name in markers}
        self._names_markers |= bool(named)
        if self._names_markers:
            unseen = np.full(3, np.nan)
            return np.array([named[m].position_mm if m in named else unseen for m in markers])
        points_mm = frame.points_mm[~frame.out_of_volume]
        believed_rad = self._beliefs.at(frame.exposed_us * 1e-6)
        return self._labeller.label(frame.exposed_us, points_mm, believed_rad)
