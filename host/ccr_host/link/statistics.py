"""How well the link works, counted at both ends."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from ccr_host.link.framing import FramingError
from ccr_host.link.messages import CountersReply

_U16 = 1 << 16


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Figures of one connection; errors and retries from its first hello on."""

    sent: int
    """Frames, repetitions included."""
    received: int
    """Whole frames."""
    crc_errors: int
    """Frames damaged on the way, on both ends, whether CRC, encoding or size has told."""
    retries: int
    rtt_us_median: float | None
    """From the first byte sent to the answer read; only where nothing was repeated."""
    rtt_us_p99: float | None
    unanswered_targets: int
    lost_telemetry: int
    clamped_targets: int
    """Outside the angle limits, so that the board has accepted others instead."""
    holds: int | None
    """How often the board held the pose for want of a fresh target; None if it was not asked."""
    relaxes: int | None
    """How often it began to lead the robot to rest, likewise."""


@dataclass
class LinkCounts:
    """Counts as they grow; :meth:`figures` sums them up."""

    sent: int = 0
    received: int = 0
    retries: int = 0
    lost_telemetry: int = 0
    clamped_targets: int = 0
    unusable: int = 0
    """Whole frames that are no message this host knows."""
    framing_errors: Counter[FramingError] = field(default_factory=Counter)
    round_trips_us: list[int] = field(default_factory=list)
    board_at_start: CountersReply | None = None
    board: CountersReply | None = None
    """As last read; None once that has failed."""

    def forget_waiting_for_the_board(self) -> None:
        """Start again once the board has answered its first hello.

        Until then a boot loader was deaf, and half a frame is no error of the line.
        """
        self.framing_errors.clear()
        self.retries = 0

    def figures(self, unanswered_targets: int) -> LinkStatistics:
        """The statistics so far."""
        median, p99 = _median_and_p99(self.round_trips_us)
        return LinkStatistics(
            sent=self.sent,
            received=self.received,
            crc_errors=self.framing_errors.total() + self._board_framing_errors(),
            retries=self.retries,
            rtt_us_median=median,
            rtt_us_p99=p99,
            unanswered_targets=unanswered_targets,
            lost_telemetry=self.lost_telemetry,
            clamped_targets=self.clamped_targets,
            holds=self._counted_by_the_board("holds"),
            relaxes=self._counted_by_the_board("relaxes"),
        )

    def _board_framing_errors(self) -> int:
        return sum(self._counted_by_the_board(error.value) or 0 for error in FramingError)

    def _counted_by_the_board(self, name: str) -> int | None:
        """On this connection, of a counter of 16 bits."""
        if self.board is None or self.board_at_start is None:
            return None
        before: int = getattr(self.board_at_start, name)
        now: int = getattr(self.board, name)
        return (now - before) % _U16


def _median_and_p99(values: list[int]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    median, p99 = np.quantile(values, [0.5, 0.99])
    return float(median), float(p99)
