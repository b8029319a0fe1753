"""How long bytes take on the wire: 8N1, ten bits a byte."""

from __future__ import annotations

_BITS_PER_BYTE = 10
_US_PER_S = 1_000_000


def wire_time_us(count: int, baud: int) -> int:
    """Time of `count` bytes, rounded up."""
    return -(-count * _BITS_PER_BYTE * _US_PER_S // baud)


def bytes_in(time_us: int, baud: int) -> int:
    """Whole bytes that pass in `time_us`."""
    return time_us * baud // (_BITS_PER_BYTE * _US_PER_S)
