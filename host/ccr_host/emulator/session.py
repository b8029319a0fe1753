"""What the board knows of the host it obeys."""

from __future__ import annotations

from dataclasses import dataclass, field

from ccr_host.link.framing import Frame

_U8 = 1 << 8


class TelemetryStream:
    """One report in so many ticks."""

    def __init__(self, period_ticks: int = 0) -> None:
        self._period_ticks = period_ticks
        self._ticks_left = period_ticks
        self._next_sequence = 0

    def tick(self) -> int | None:
        """Sequence number of the report that is due at this tick, if one is."""
        if not self._period_ticks:
            return None
        self._ticks_left -= 1
        if self._ticks_left:
            return None
        self._ticks_left = self._period_ticks
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % _U8
        return sequence


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The last `once` request that was acknowledged, and how."""

    request: Frame
    answer: bytes
    tick: int
    is_void: bool = False
    """A stop has come since: it is neither executed nor acknowledged again."""


@dataclass(slots=True)
class Session:
    """One session; a new one starts with nothing remembered and no telemetry."""

    number: int | None = None
    """None before the first session after a reset."""
    telemetry: TelemetryStream = field(default_factory=TelemetryStream)
    acknowledged: Acknowledged | None = None
