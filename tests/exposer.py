"""Markers whose motion a test knows, in front of an emulated camera, and a running camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from ccr_host.sim.polaris.sensor import PositionSensor
from ccr_host.tracking.tracker import RawTracker


class Exposer:
    """Exposes a sensor to markers given as a function of time, us: positions in mm, (n, 3)."""

    def __init__(
        self, sensor: PositionSensor, source: Callable[[int], NDArray[np.float64]]
    ) -> None:
        self._sensor = sensor
        self._source = source

    def advance_to(self, time_us: int) -> None:
        """Make the exposures due by `time_us`."""
        while (exposure_us := self._sensor.next_exposure_us) <= time_us:
            self._sensor.expose(exposure_us, self._source(exposure_us))


@contextmanager
def running(camera: RawTracker) -> Iterator[None]:
    """Start a camera, and stop it at the end."""
    camera.start()
    try:
        yield
    finally:
        camera.stop()
