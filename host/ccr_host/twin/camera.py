"""The camera as the twin simulates it: noise, rate, latency, dropout, misalignment."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Tracker
from ccr_host.tracking.rotation import rotation_matrix
from ccr_host.tracking.sample import Sample

Array = NDArray[np.float64]


class Camera:
    """Exposes the markers at a fixed rate and delivers each sample after a latency.

    The generator is used once an exposure, whatever becomes of the sample.

    Args:
        tracker: the ``tracker`` section of the robot description.
        rng: source of noise and dropout.
    """

    def __init__(self, tracker: Tracker, rng: np.random.Generator) -> None:
        self._tracker = tracker
        self._rng = rng
        # M3 - M1 has six independent components of error.
        self._noise_per_coordinate_mm = tracker.noise_mm / math.sqrt(6)
        self._robot_to_camera = rotation_matrix(np.radians(tracker.rotation_deg)).T
        self._latency_us = round(tracker.latency_ms * 1000)
        self._exposures = 0
        self.next_exposure_us = 0
        """When to call ``expose`` next."""
        self._in_flight: deque[Sample] = deque()
        self._newest: Sample | None = None

    @property
    def rate_hz(self) -> float:
        """Exposures a second."""
        return self._tracker.rate_hz

    @property
    def next_arrival_us(self) -> int:
        """Before then ``newest`` gives nothing new."""
        exposed_us = self._in_flight[0].exposed_us if self._in_flight else self.next_exposure_us
        return exposed_us + self._latency_us

    def expose(self, time_us: int, markers_mm: Array) -> None:
        """Take a picture of the markers, (3, 3), one a row, in the robot's frame."""
        self._exposures += 1
        self.next_exposure_us = round(self._exposures * 1e6 / self._tracker.rate_hz)
        noise_mm = self._noise_per_coordinate_mm * self._rng.standard_normal((3, 3))
        dropped = self._rng.random() < self._tracker.dropout
        if not dropped:
            seen_mm = markers_mm @ self._robot_to_camera.T + noise_mm
            self._in_flight.append(Sample(time_us, seen_mm))

    def newest(self, time_us: int) -> Sample | None:
        """Return the latest sample that has arrived by a time; times must not go backwards."""
        while self._in_flight and self._in_flight[0].exposed_us + self._latency_us <= time_us:
            self._newest = self._in_flight.popleft()
        return self._newest
