"""Tracker ``twin:``, the simulated camera, read without a protocol."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import scipy

from ccr_host.core.arrays import Array
from ccr_host.core.clock import Clock
from ccr_host.description.simulation import Tracker
from ccr_host.tracking.tracker import Sample, TrackerHealth

_LOOKS = 5
"""Looks at the moving markers in one exposure: their mean is that of a steady motion exactly, and
that of a vibration with one period per exposure within 2 % of its amplitude."""
_MOST_JITTER = 0.45
"""Jitter is cut off at this share of the time between exposures, so that they keep their order."""


class Shutter:
    """The exposures of a simulated camera: jitter, motion blur and outliers.

    An exposure is made of looks at the markers, evenly spread about its middle. Its middle deviates
    by the jitter from the time that the picture states. The random numbers are drawn from a
    generator of their own: noise and dropout of a seed are the same with and without these faults.
    The first of ``rate_hz`` exposures is at 0.
    """

    def __init__(self, tracker: Tracker, rate_hz: float, rng: np.random.Generator) -> None:
        self._tracker = tracker
        self._period_us = 1e6 / rate_hz
        self._exposure_us = min(1000 * tracker.exposure_ms, self._period_us)
        (self._rng,) = rng.spawn(1)
        self._looks = _LOOKS if tracker.exposure_ms > 0 else 1
        self._seen_mm: list[Array] = []
        self._number = 0
        self._jitter_us = self._draw_jitter_us()

    @property
    def stated_us(self) -> int:
        """Time that the next picture states."""
        return round(self._number * self._period_us)

    @property
    def next_look_us(self) -> int:
        """Time of the next call of `look`, at least 0."""
        share = (len(self._seen_mm) + 0.5) / self._looks - 0.5
        offset_us = self._jitter_us + share * self._exposure_us
        return max(0, self.stated_us + round(offset_us))

    def look(self, markers_mm: Array) -> Array | None:
        """Look at the markers, one per row; return the picture when the exposure is complete."""
        self._seen_mm.append(markers_mm)
        if len(self._seen_mm) < self._looks:
            return None
        seen_mm: Array = self._seen_mm[0] if self._looks == 1 else np.mean(self._seen_mm, axis=0)
        self._seen_mm = []
        self._number += 1
        self._jitter_us = self._draw_jitter_us()
        return self._with_outlier(seen_mm)

    def _draw_jitter_us(self) -> float:
        if not self._tracker.frame_jitter_ms:
            return 0.0
        most_us = _MOST_JITTER * (self._period_us - self._exposure_us)
        drawn_us = 1000 * self._tracker.frame_jitter_ms * self._rng.standard_normal()
        return min(max(drawn_us, -most_us), most_us)

    def _with_outlier(self, markers_mm: Array) -> Array:
        if not self._tracker.outliers or self._rng.random() >= self._tracker.outliers:
            return markers_mm
        direction = self._rng.standard_normal(3)
        seen_mm = markers_mm.copy()
        row = self._rng.integers(len(markers_mm))
        seen_mm[row] += self._tracker.outlier_mm * direction / np.linalg.norm(direction)
        return seen_mm


class Camera:
    """Exposes the markers at a fixed rate and delivers each sample after a latency.

    The generator is used as often for a sample that is dropped.
    """

    def __init__(self, tracker: Tracker, rng: np.random.Generator) -> None:
        self._tracker = tracker
        self._rng = rng
        # The tip relative to M1 contains six independent errors.
        self._noise_per_coordinate_mm = tracker.noise_mm / math.sqrt(6)
        self._robot_to_camera = np.eye(3)
        if any(tracker.rotation_deg):  # scipy's rotations take 0.2 s to load
            turn = scipy.spatial.transform.Rotation.from_rotvec(tracker.rotation_deg, degrees=True)
            self._robot_to_camera = turn.inv().as_matrix()
        self._latency_us = round(tracker.latency_ms * 1000)
        self._shutter = Shutter(tracker, tracker.rate_hz, rng)
        self._in_flight: deque[Sample] = deque()
        self._newest: Sample | None = None

    @property
    def rate_hz(self) -> float:
        return self._tracker.rate_hz

    @property
    def next_exposure_us(self) -> int:
        return self._shutter.next_look_us

    @property
    def next_arrival_us(self) -> int:
        """Time before which ``newest`` returns nothing new."""
        if self._in_flight:
            return self._in_flight[0].exposed_us + self._latency_us
        return max(self._shutter.stated_us + self._latency_us, self._shutter.next_look_us)

    def expose(self, time_us: int, markers_mm: Array) -> None:
        stated_us = self._shutter.stated_us
        picture_mm = self._shutter.look(markers_mm)
        if picture_mm is None:
            return
        noise_mm = self._noise_per_coordinate_mm * self._rng.standard_normal(picture_mm.shape)
        dropped = self._rng.random() < self._tracker.dropout
        if not dropped:
            seen_mm = picture_mm @ self._robot_to_camera.T + noise_mm
            self._in_flight.append(Sample(stated_us, seen_mm))

    def newest(self, time_us: int) -> Sample | None:
        """Return the latest sample that has arrived by a time; times must not go backwards."""
        while self._in_flight and self._in_flight[0].exposed_us + self._latency_us <= time_us:
            self._newest = self._in_flight.popleft()
        return self._newest


class TwinTracker:
    """Reads the camera of a twin.

    ``camera_to_robot`` is the registered rotation, (3, 3); None leaves samples in the camera's
    frame.
    """

    name = "twin:"

    def __init__(self, camera: Camera, clock: Clock, camera_to_robot: Array | None = None) -> None:
        self._camera = camera
        self._clock = clock
        self._camera_to_robot = camera_to_robot
        self._seen: Sample | None = None
        self._newest: Sample | None = None

    @property
    def health(self) -> TrackerHealth:
        rate_hz = self._camera.rate_hz
        return TrackerHealth(state="tracking", tracking=True, rate_hz=rate_hz)

    def newest(self) -> Sample | None:
        sample = self._camera.newest(self._clock.now_us())
        if sample is not self._seen:
            self._seen = sample
            self._newest = None if sample is None else self._turned(sample)
        return self._newest

    @property
    def next_arrival_us(self) -> int:
        return self._camera.next_arrival_us

    def trouble(self) -> str:
        """Always empty: the simulated camera has only the faults of the description."""
        return ""

    def _turned(self, sample: Sample) -> Sample:
        if self._camera_to_robot is None:
            return sample
        return Sample(sample.exposed_us, sample.markers_mm @ self._camera_to_robot.T)
