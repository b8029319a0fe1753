"""Relates the board's clock to the host's."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

_WRAP_US = 1 << 32
_WINDOW = 64
"""Number of exchanges, one every ten seconds; they determine the drift to about 5 ppm."""
_MOST_DRIFT = 0.01
"""Drift of an UNO's ceramic resonator; that of a crystal is a hundredth of it."""
_WANDER = 5e-6
"""Change of the drift itself over a window, as a crystal warms up."""
_SHORTEST_US = 50.0
"""Half round trips shorter than this are weighted as if they took this long."""


@dataclass(frozen=True, slots=True)
class _Exchange:
    host_us: int
    """Host time at the middle of the exchange."""
    offset_us: int
    """Board time minus host time, accurate to half the round trip."""
    half_trip_us: float


class BoardClock:
    """Estimates offset and drift of the board's clock from `clock_sync` exchanges.

    Each exchange gives the offset at its time, to half its round trip. A line through the last
    exchanges gives the drift. The offset is extrapolated with this drift from the exchange that
    is least uncertain now, considering its round trip and age. An exchange that contradicts the
    estimate, after a reset of the board or a sleep of the host, discards all earlier ones.
    """

    def __init__(self) -> None:
        self._exchanges: deque[_Exchange] = deque(maxlen=_WINDOW)
        self.drift = 0.0
        """Relative rate by which the board's clock is faster than the host's: 1e-6 is 1 ppm."""
        self._drift_error = _MOST_DRIFT

    def add(self, sent_us: int, received_us: int, board_time_us: int) -> None:
        """Add an exchange; the board's 32-bit time is unwrapped by the present estimate."""
        host_us = (sent_us + received_us) // 2
        half_trip_us = max((received_us - sent_us + 1) / 2, _SHORTEST_US)
        offset_us = board_time_us - host_us
        expected_us, uncertainty_us = self.offset_us(host_us), self.uncertainty_us(host_us)
        if expected_us is not None and uncertainty_us is not None:
            away_us = (offset_us - expected_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
            if abs(away_us) <= half_trip_us + uncertainty_us:
                offset_us = expected_us + away_us
            else:
                self._exchanges.clear()
        self._exchanges.append(_Exchange(host_us, offset_us, half_trip_us))
        self._fit_drift()

    def offset_us(self, host_us: int) -> int | None:
        """Board time minus host time, at a host time; None before the first exchange."""
        if not self._exchanges:
            return None
        best = min(self._exchanges, key=lambda exchange: self._error_us(exchange, host_us))
        return best.offset_us + round(self.drift * (host_us - best.host_us))

    def uncertainty_us(self, host_us: int) -> int | None:
        """Bound of the offset's error at a host time; None before the first exchange."""
        if not self._exchanges:
            return None
        least_us = min(self._error_us(exchange, host_us) for exchange in self._exchanges)
        return int(np.ceil(least_us))

    def _error_us(self, exchange: _Exchange, host_us: int) -> float:
        return exchange.half_trip_us + self._drift_error * abs(host_us - exchange.host_us)

    def _fit_drift(self) -> None:
        """Fit by weighted least squares; the bound assumes the largest error of each exchange."""
        first = self._exchanges[0]
        time_us = np.array([float(one.host_us - first.host_us) for one in self._exchanges])
        offset_us = np.array([float(one.offset_us - first.offset_us) for one in self._exchanges])
        half_trip_us = np.array([one.half_trip_us for one in self._exchanges])
        weight = half_trip_us**-2.0
        time_us -= np.average(time_us, weights=weight)
        about_drift = float((weight * time_us**2).sum())
        known_before = _MOST_DRIFT**-2.0
        self.drift = float((weight * time_us * offset_us).sum()) / (about_drift + known_before)
        worst = float((np.abs(time_us) / half_trip_us).sum()) + known_before * _MOST_DRIFT
        self._drift_error = min(worst / (about_drift + known_before) + _WANDER, _MOST_DRIFT)
