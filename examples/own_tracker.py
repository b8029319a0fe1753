"""A tracker of your own, here one that sees the simulated robot.

ccr-host track 8shape --tracker examples/own_tracker.py:CoarseCamera

The driver of a real camera leaves out `next_exposure_us` and `expose`. Its `advance_to`, called
every millisecond, takes what has arrived without waiting for it.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

import ccr_host

PERIOD_US = 100_000
LATENCY_US = 30_000
GRAIN_MM = 0.5
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


class CoarseCamera:
    """Ten images per second, rounded to half a millimetre."""

    def __init__(self, description: ccr_host.Description) -> None:
        self.next_exposure_us = 0
        self._in_flight: deque[ccr_host.MarkerFrame] = deque()
        self._newest: ccr_host.MarkerFrame | None = None

    def start(self) -> None:
        """Nothing to open."""

    def stop(self) -> None:
        """Nothing to close."""

    def expose(self, time_us: int, markers_mm: NDArray[np.float64]) -> None:
        self.next_exposure_us = time_us + PERIOD_US
        seen_mm = np.round(markers_mm / GRAIN_MM) * GRAIN_MM
        bodies = {f"M{n}": ccr_host.Pose(at, UNTURNED) for n, at in enumerate(seen_mm, start=1)}
        single_points = np.empty((0, 3)), np.empty(0, dtype=bool)
        number = time_us // PERIOD_US
        self._in_flight.append(ccr_host.MarkerFrame(time_us, number, *single_points, bodies))

    def advance_to(self, time_us: int) -> None:
        while self._in_flight and self._in_flight[0].exposed_us + LATENCY_US <= time_us:
            self._newest = self._in_flight.popleft()

    def newest_frame(self) -> ccr_host.MarkerFrame | None:
        return self._newest


if __name__ == "__main__":
    with ccr_host.open_robot(tracker=CoarseCamera) as robot:
        summary = robot.track("8shape", "mpc", with_open=False).summary
    print(f"mean error {summary['mean_error_mm']:.1f} mm")
