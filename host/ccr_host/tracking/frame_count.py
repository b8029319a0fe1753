"""Newest frame and statistics of a camera that only delivers."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from ccr_host.tracking.tracker import FloatArray, MarkerFrame, Pose

_RATE_FRAMES = 20


class FrameCount:
    """Keeps the newest frame, sees to it that frames never go back, and measures their rate."""

    def __init__(self) -> None:
        self.newest: MarkerFrame | None = None
        self.count = 0
        self._exposures_us: deque[int] = deque(maxlen=_RATE_FRAMES)

    @property
    def rate_hz(self) -> float:
        """Of the last frames."""
        times_us = self._exposures_us
        if len(times_us) < 2:  # noqa: PLR2004 - a rate needs an interval
            return 0.0
        return (len(times_us) - 1) * 1e6 / (times_us[-1] - times_us[0])

    def not_before_last(self, exposed_us: int) -> int:
        """An estimate of an exposure that is later than the last one: fits improve."""
        return exposed_us if self.newest is None else max(exposed_us, self.newest.exposed_us + 1)

    def add(self, frame: MarkerFrame) -> None:
        """Take a new frame."""
        self.newest = frame
        self.count += 1
        self._exposures_us.append(frame.exposed_us)

    def add_poses(
        self, exposed_us: int, tools: Mapping[str, Pose], points_mm: FloatArray | None = None
    ) -> None:
        """Take a new frame of a camera that numbers none and has no volume."""
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
