"""From the device's frame counter to exposure times on the run's clock."""

from __future__ import annotations

from ccr_host.tracking.clock_fit import ClockFit

COUNTER_HZ = 60
"""The frame counter of every Polaris, whatever its rate of new data."""


class ExposureClock:
    """Knows when a frame is available in the device, and when it was exposed.

    Args:
        latency_us: from an exposure to its being available in the device.
    """

    def __init__(self, latency_us: int) -> None:
        self._latency_us = latency_us
        self._fit = ClockFit()

    def see(self, frame_number: int, seen_us: int) -> int:
        """Take note of a new frame; return when it was exposed."""
        self._fit.see(_counted_us(frame_number), seen_us)
        return self.available_us(frame_number) - self._latency_us

    def available_us(self, frame_number: int) -> int:
        """When a frame was or will be available; there must have been one before."""
        return self._fit.host_us(_counted_us(frame_number))


def _counted_us(frame_number: int) -> int:
    return round(frame_number * 1_000_000 / COUNTER_HZ)
