"""Tracker `replay:FILE`: the samples of a recorded run, at the pace at which they were taken."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from ccr_host.tracking.tracker import FrameCount, MarkerFrame, Pose, TrackerHealth

_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


class ReplayTracker:
    """Delivers each recorded sample once its time has come; time 0 is the first exposure.

    The markers were labelled when they were recorded, so they come as tools with their names.
    ``address`` is the folder of a run, or one file of its log.

    Raises:
        ConfigError: no such file, no samples in it, or samples of another number of markers.
    """

    def __init__(self, description: Description, address: str) -> None:
        self.name = f"replay:{address}"
        self._latency_us = round(description.tracker.latency_ms * 1000)
        self._markers = description.robot.markers
        self._samples = deque(_read(Path(address), len(self._markers)))
        self._start_us: int | None = None
        self._frames = FrameCount()
        self._running = False

    @property
    def health(self) -> TrackerHealth:
        if not self._running:
            state = "stopped"
        else:
            state = "replaying" if self._samples else "at the end of the recording"
        return TrackerHealth(
            state=state,
            tracking=self._running and bool(self._samples),
            rate_hz=self._frames.rate_hz,
            frames=self._frames.count,
        )

    def start(self) -> None:
        self._running = True

    def advance_to(self, time_us: int) -> None:
        if not self._running:
            return
        if self._start_us is None:
            self._start_us = time_us - self._samples[0][0]
        while self._samples:
            exposed_us = self._start_us + self._samples[0][0]
            if exposed_us + self._latency_us > time_us:
                return
            _, markers_mm = self._samples.popleft()
            poses = (Pose(marker_mm, _UNTURNED) for marker_mm in markers_mm)
            self._frames.add_poses(exposed_us, dict(zip(self._markers, poses, strict=True)))

    def newest_frame(self) -> MarkerFrame | None:
        return self._frames.newest

    def stop(self) -> None:
        self._running = False


def _read(path: Path, markers: int) -> list[tuple[int, Array]]:
    """Exposure times in us and markers, (markers, 3), in order of time."""
    recorded = RunRecording(path).messages(topics.SAMPLE)
    samples = [_sample(path, message.content, markers) for message in recorded]
    if not samples:
        raise ConfigError(f"recording {path}: no samples in it", "give the log of another run")
    return sorted(samples, key=lambda sample: sample[0])


def _sample(path: Path, content: dict[str, Any], markers: int) -> tuple[int, Array]:
    try:
        markers_mm = np.array(content["markers_mm"], dtype=np.float64)
        exposed_us = content["exposed_us"]
        if not isinstance(exposed_us, int) or markers_mm.shape != (len(markers_mm), 3):
            raise ValueError
    except (ValueError, KeyError, TypeError):
        raise ConfigError(f"recording {path}: not the log of a run", "record it again") from None
    if len(markers_mm) != markers:
        raise ConfigError(
            f"recording {path}: {len(markers_mm)} markers, the robot has {markers}",
            "give the description of the robot that was recorded: --robot",
        )
    return exposed_us, markers_mm
