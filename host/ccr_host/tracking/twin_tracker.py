"""Tracker ``twin:``, the simulated camera read without a protocol."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.run.clock import Clock
from ccr_host.tracking.frame import TrackerHealth
from ccr_host.tracking.sample import Sample
from ccr_host.twin.camera import Camera


class TwinTracker:
    """Reads the camera of a twin.

    Args:
        camera: exposed by the twin's scene.
        clock: of the run.
        camera_to_robot: the registered rotation, (3, 3); None leaves samples in the camera's frame.
    """

    name = "twin:"

    def __init__(
        self, camera: Camera, clock: Clock, camera_to_robot: NDArray[np.float64] | None = None
    ) -> None:
        self._camera = camera
        self._clock = clock
        self._camera_to_robot = camera_to_robot
        self._seen: Sample | None = None
        self._newest: Sample | None = None

    @property
    def health(self) -> TrackerHealth:
        """What can be told without a protocol."""
        rate_hz = self._camera.rate_hz
        return TrackerHealth(state="tracking", tracking=True, rate_hz=rate_hz)

    def newest(self) -> Sample | None:
        """Newest sample that has arrived."""
        sample = self._camera.newest(self._clock.now_us())
        if sample is not self._seen:
            self._seen = sample
            self._newest = None if sample is None else self._turned(sample)
        return self._newest

    @property
    def next_arrival_us(self) -> int:
        """Before then ``newest`` gives nothing new."""
        return self._camera.next_arrival_us

    def trouble(self) -> str:
        """The simulated camera has none but those that the description gives it."""
        return ""

    def _turned(self, sample: Sample) -> Sample:
        if self._camera_to_robot is None:
            return sample
        return Sample(sample.exposed_us, sample.markers_mm @ self._camera_to_robot.T)
