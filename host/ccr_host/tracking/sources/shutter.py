"""When a simulated camera looks at the markers, and what of it a picture shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.simulation import Tracker

Array = NDArray[np.float64]

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

    Args:
        tracker: the ``tracker`` section of the robot description.
        rate_hz: exposures per second; the first one is at 0.
        rng: the camera's generator, from which a child is spawned.
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
