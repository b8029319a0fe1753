"""Waiting for a camera that needs seconds to start."""

from __future__ import annotations

from ccr_host.errors import TrackerError
from ccr_host.run.clock import Clock
from ccr_host.tracking.frame import RawTracker

DEFAULT_TIMEOUT_US = 20_000_000
"""A Polaris takes up to 7 s for a reset and as long again when its break is not heard."""
_LOOK_US = 10_000


def wait_until_tracking(
    tracker: RawTracker, clock: Clock, timeout_us: int = DEFAULT_TIMEOUT_US
) -> None:
    """Let the clock run until the first frame is there; the tracker is attached to the clock.

    Raises:
        TrackerError: no frame in time; tells what the driver was doing and its last failure.
    """
    deadline_us = clock.now_us() + timeout_us
    while tracker.newest_frame() is None:
        if clock.now_us() >= deadline_us:
            health = tracker.health
            raise TrackerError(
                f"{tracker.name}: no frame within {timeout_us / 1e6:g} s, still {health.state}",
                health.last_error or "check power and cable of the camera",
            )
        clock.sleep_until_us(clock.now_us() + _LOOK_US)
