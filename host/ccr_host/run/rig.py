"""What a control loop works with, on hardware, the twin or a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.clock import Clock
from ccr_host.link.client import Client
from ccr_host.tracking.tracker import Tracker

if TYPE_CHECKING:
    from ccr_host.run.tape import Tape


@dataclass(frozen=True)
class Rig:
    """A connected board and a tracker, and the clock of both."""

    clock: Clock
    client: Client
    tracker: Tracker
    tape: Tape
    """Records the inputs of the host through this rig."""
    start_path_clock: Callable[[int], None] = lambda _: None
    """Sets the time in us from which the description's timed disturbances count."""
    true_tip_mm: Callable[[], NDArray[np.float64] | None] = lambda: None
    """True f, (3,), for the metrics only; None if the robot is real or recorded."""
