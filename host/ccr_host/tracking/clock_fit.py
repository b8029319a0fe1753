"""From a device's clock to the run's, without a common one."""

from __future__ import annotations

from collections import deque

_WINDOW = 128
"""Long enough to hold an arrival that nothing delayed, short enough for the drift of two quartzes:
6 s at 20 Hz, 0.6 ms at 100 ppm."""


class ClockFit:
    """Fits the device's clock to the host's by the least delay over a window.

    Everything between the two only ever delays, so the least delay is the one to go by.
    """

    def __init__(self) -> None:
        self._offsets_us: deque[int] = deque(maxlen=_WINDOW)

    def see(self, device_us: int, seen_us: int) -> None:
        """Something stamped `device_us` was seen at `seen_us` of the run's clock."""
        self._offsets_us.append(seen_us - device_us)

    def host_us(self, device_us: int) -> int:
        """The run's time of a device time; something must have been seen before."""
        return min(self._offsets_us) + device_us
