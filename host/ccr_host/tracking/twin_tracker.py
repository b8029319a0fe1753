"""Tracker ``twin:``, the simulated camera read without a protocol."""

from __future__ import annotations

from ccr_host.run.clock import Clock
from ccr_host.tracking.sample import Sample
from ccr_host.twin.scene import TwinScene


class TwinTracker:
    """Reads the camera of a twin."""

    name = "twin:"

    def __init__(self, scene: TwinScene, clock: Clock) -> None:
        self._scene = scene
        self._clock = clock

    def newest(self) -> Sample | None:
        """Newest sample that has arrived."""
        return self._scene.newest_sample(self._clock.now_us())
