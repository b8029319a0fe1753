"""How long tests wait for what must happen, on machines of any speed."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 300
"""Only what is wrong takes so long: a busy machine makes a run of 15 s take a minute or two."""
_LOOK_S = 0.02


def becomes_true(holds: Callable[[], object]) -> bool:
    """Wait for a condition; whether it holds in the end."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (held := bool(holds())) and time.monotonic() < deadline_s:
        time.sleep(_LOOK_S)
    return held
