"""The small interface of every tracker."""

from __future__ import annotations

from typing import Protocol

from ccr_host.tracking.frame import TrackerHealth
from ccr_host.tracking.sample import Sample


class Tracker(Protocol):
    """Source of marker positions; samples never go back in time."""

    name: str

    def newest(self) -> Sample | None:
        """Newest sample that has arrived, whatever its age; None before the first."""

    def trouble(self) -> str:
        """Why there may be no newer sample, for people to read; empty if nothing is known."""


class WatchedTracker(Tracker, Protocol):
    """A tracker that also tells how it is doing."""

    @property
    def health(self) -> TrackerHealth:
        """Of the camera."""
