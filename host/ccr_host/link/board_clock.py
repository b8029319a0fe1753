"""Relates the board's clock to the host's."""

from __future__ import annotations

from dataclasses import dataclass

_WRAP_US = 1 << 32


@dataclass(frozen=True, slots=True)
class _Estimate:
    round_trip_us: int
    host_us: int
    board_us: int


class BoardClock:
    """Offset from `clock_sync`: of many exchanges the fastest one is the least uncertain."""

    def __init__(self) -> None:
        self._last: _Estimate | None = None
        self._best: _Estimate | None = None

    def add(self, sent_us: int, received_us: int, board_time_us: int) -> None:
        """Take one exchange; the board's 32-bit time is unwrapped against the one before."""
        middle_us = (sent_us + received_us) // 2
        estimate = _Estimate(
            received_us - sent_us, middle_us, self._unwrapped(board_time_us, middle_us)
        )
        self._last = estimate
        if self._best is None or estimate.round_trip_us <= self._best.round_trip_us:
            self._best = estimate

    @property
    def offset_us(self) -> int | None:
        """Board time minus host time; None before the first exchange."""
        return None if self._best is None else self._best.board_us - self._best.host_us

    @property
    def uncertainty_us(self) -> int | None:
        """The offset is at most so wrong, drift aside: half the fastest round trip."""
        return None if self._best is None else (self._best.round_trip_us + 1) // 2

    def _unwrapped(self, board_time_us: int, host_us: int) -> int:
        if self._last is None:
            return board_time_us
        expected_us = self._last.board_us + host_us - self._last.host_us
        ahead_us = (board_time_us - expected_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
        return expected_us + ahead_us
