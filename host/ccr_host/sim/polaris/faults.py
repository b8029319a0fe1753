"""Faults of a Polaris, each of which can be injected separately."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Span = tuple[int, int]


class BitOrder(Enum):
    """Which end of the out-of-volume bits is the first stray; open-source parsers differ."""

    FIRST_IS_HIGHEST = "first is highest"
    FIRST_IS_LOWEST = "first is lowest"


@dataclass(frozen=True)
class PolarisFaults:
    """Injected faults, by default none.

    Probabilities are per exposure or reply; intervals and times are in the run's clock.
    """

    shuffle: bool = False
    """Report strays in random order."""
    phantoms: int = 0
    """Number of false points per frame."""
    occlusion: float = 0.0
    """Probability that a marker is hidden in an exposure."""
    occluded_us: tuple[Span, ...] = ()
    """Intervals in which all markers are hidden."""
    frozen: float = 0.0
    """Probability that an exposure is skipped and the previous frame repeated."""
    out_of_volume: bool = False
    """Move the scene beyond the far end of the measurement volume."""
    out_of_volume_us: tuple[Span, ...] = ()
    """Intervals in which the scene is beyond the far end of the measurement volume."""
    bad_crc: float = 0.0
    """Probability that a byte of a reply is changed in transit."""
    silent_us: tuple[Span, ...] = ()
    """Intervals in which commands are ignored."""
    unplugged_us: tuple[Span, ...] = ()
    """Intervals in which the host's port is gone."""
    resets_us: tuple[int, ...] = ()
    """Times at which the power fails for a moment."""
    too_hot: bool = False
    """Set the status bit for a temperature outside the operating range."""
    diagnostic_pending: bool = False
    """Set the status bit for a bump or another diagnostic."""
    comm_refused: bool = False
    """Answer COMM with ERROR06 and keep the bit rate."""
    wrong_frames_us: tuple[Span, ...] = ()
    """Intervals in which the frame numbers in replies are far too high."""
    pinit_warning: bool = False
    """Answer PINIT with WARNING05 instead of OKAY."""
    bit_order: BitOrder = BitOrder.FIRST_IS_HIGHEST


NO_FAULTS = PolarisFaults()


def is_within(time_us: int, spans: tuple[Span, ...]) -> bool:
    """Whether a time lies in one of the intervals [start, end)."""
    return any(start <= time_us < end for start, end in spans)
