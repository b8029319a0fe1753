"""Checks of this computer."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ccr_host.bringup.finding import Finding, good, judged
from ccr_host.run.clock import Clock
from ccr_host.run.versions import versions

EXTRAS = {
    "view": "viser",
    "export": "pyarrow",
    "sweep": "distributed",
    "fast": "numba",
    "igtl": "pyigtl",
    "aruco": "cv2",
    "firmware": "platformio",
}
"""Extras by one of their packages."""

_NAPS = 200
_NAP_US = 1000
_LATE_US = 5000
"""A quarter of the board's tick, and less than what a camera's latency varies by."""
_LEAST_FREE_BYTES = 1_000_000_000


def check_host(clock: Clock, folder: Path) -> Iterator[Finding]:
    """Versions, extras, disk, and how late this process wakes.

    Args:
        clock: real.
        folder: in which runs are kept.
    """
    yield good("versions", ", ".join(f"{name} {value}" for name, value in versions().items()))
    yield _extras()
    free_bytes = shutil.disk_usage(folder).free
    yield judged(
        "disk",
        f"{free_bytes / 1e9:.1f} GB free for runs in {folder.resolve()}",
        fine=free_bytes > _LEAST_FREE_BYTES,
        remedy="make room, or start from another folder",
    )
    late_us = _lateness_us(clock)
    yield judged(
        "timing",
        f"this process wakes {np.median(late_us):.0f} us late, at most {late_us.max():.0f} us",
        fine=bool(late_us.max() < _LATE_US),
        remedy="end what else keeps this computer busy; let it run on full power",
    )


def _extras() -> Finding:
    there = [name for name, module in EXTRAS.items() if importlib.util.find_spec(module)]
    missing = [name for name in EXTRAS if name not in there]
    text = f"installed: {', '.join(there) or 'none'}"
    if missing:
        text += f'; for more: pip install "ccr-host[{",".join(missing)}]"'
    return good("extras", text)


def _lateness_us(clock: Clock) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    late = np.empty(_NAPS)
    for nap in range(_NAPS):
        due_us = clock.now_us() + _NAP_US
        clock.sleep_until_us(due_us)
        late[nap] = clock.now_us() - due_us
    return late
