"""What can go wrong with a Polaris, each to be switched on by itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Span = tuple[int, int]


class BitOrder(Enum):
    """Which end of the out-of-volume bits belongs to the first stray; open parsers disagree."""

    FIRST_IS_HIGHEST = "first is highest"
    FIRST_IS_LOWEST = "first is lowest"


@dataclass(frozen=True)
class PolarisFaults:
    """By default none. Probabilities are per exposure or reply; spans are of the run's clock."""

    shuffle: bool = False
    """Strays come in random order."""
    phantoms: int = 0
    """So many points a frame that are no marker."""
    occlusion: float = 0.0
    """Probability that a marker is hidden in an exposure."""
    occluded_us: tuple[Span, ...] = ()
    """All markers are hidden."""
    frozen: float = 0.0
    """Probability that an exposure is skipped: its frame is repeated instead."""
    out_of_volume: bool = False
    """The scene is moved beyond the far end of the volume."""
    out_of_volume_us: tuple[Span, ...] = ()
    """The same for a while."""
    bad_crc: float = 0.0
    """Probability that a byte of a reply is changed on its way."""
    silent_us: tuple[Span, ...] = ()
    """Commands are not heard."""
    unplugged_us: tuple[Span, ...] = ()
    """The host's port is gone."""
    resets_us: tuple[int, ...] = ()
    """The power fails for a moment."""
    too_hot: bool = False
    """Status bit for a temperature outside the operating range."""
    diagnostic_pending: bool = False
    """Status bit for a bump or another finding of the self-test."""
    comm_refused: bool = False
    """COMM is answered with ERROR06: the rate stays."""
    odd_frames_us: tuple[Span, ...] = ()
    """Frame numbers in replies are far too high."""
    pinit_warning: bool = False
    """PINIT answers WARNING05 instead of OKAY."""
    bit_order: BitOrder = BitOrder.FIRST_IS_HIGHEST


NO_FAULTS = PolarisFaults()


def is_within(time_us: int, spans: tuple[Span, ...]) -> bool:
    """Whether a time lies in one of the spans."""
    return any(start <= time_us < end for start, end in spans)
