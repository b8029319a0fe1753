"""Waiting for a camera that needs seconds to start."""

from __future__ import annotations

from ccr_host.errors import TrackerError
from ccr_host.run.clock import Clock
from ccr_host.tracking.frame import RawTracker

DEFAULT_TIMEOUT_US = 20_000_000
"""A Polaris takes up to 7 s for a reset and as long again when its break is not heard."""
_MOST_RECONNECTIONS = 4
"""What closes the connection time after time will not become a camera by waiting."""
_LOOK_US = 10_000


def wait_until_tracking(
    tracker: RawTracker, clock: Clock, timeout_us: int = DEFAULT_TIMEOUT_US
) -> None:
    """Let the clock run until the first frame is there; the tracker is attached to the clock.

    Raises:
        TrackerError: no frame in time; tells what the driver was doing and its last failure.
    """
    start_us = clock.now_us()
    while tracker.newest_frame() is None:
        health, waited_us = tracker.health, clock.now_us() - start_us
        if waited_us >= timeout_us or health.reconnections >= _MOST_RECONNECTIONS:
            told = "; ".join([f"still {health.state}", *health.warnings])
            raise TrackerError(
                f"{tracker.name}: no frame within {waited_us / 1e6:.0f} s, {told}",
                health.last_error or "check power and cable of the camera",
            )
        clock.sleep_until_us(clock.now_us() + _LOOK_US)
