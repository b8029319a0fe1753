"""What a control loop works with, on hardware, the twin or a recording."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.clock import Clock
from ccr_host.link.client import Client
from ccr_host.tracking.tracker import Sample

if TYPE_CHECKING:
    from ccr_host.run.recording import Tape


MOST_ARRIVED = 1024
"""Ten seconds of a fast camera, the longest control period."""


class RunTracker(ABC):
    """A tracker that keeps the samples that arrive between two looks."""

    name: str

    def __init__(self) -> None:
        self._newest: Sample | None = None
        self._arrived: deque[Sample] = deque(maxlen=MOST_ARRIVED)

    def newest(self) -> Sample | None:
        """Newest sample that has arrived, whatever its age; None before the first."""
        return self._newest

    def arrived(self) -> list[Sample]:
        """The samples that have arrived since the last call, oldest first."""
        arrived = list(self._arrived)
        self._arrived.clear()
        return arrived

    @abstractmethod
    def trouble(self) -> str:
        """Why there may be no newer sample, for users; empty if unknown."""

    def _take(self, sample: Sample) -> None:
        self._newest = sample
        self._arrived.append(sample)


@dataclass(frozen=True)
class Rig:
    """A connected board and a tracker, and the clock of both."""

    clock: Clock
    client: Client
    tracker: RunTracker
    tape: Tape
    """Records the inputs of the host through this rig."""
    start_path_clock: Callable[[int], None] = lambda _: None
    """Sets the time in us from which the description's timed disturbances count."""
    true_tip_mm: Callable[[], NDArray[np.float64] | None] = lambda: None
    """True f, (3,), for the metrics only; None if the robot is real or recorded."""
