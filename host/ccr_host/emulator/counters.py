"""What the board counts since its reset."""

from __future__ import annotations

from collections import Counter

from ccr_host.link.framing import FramingError
from ccr_host.link.messages import CountersReply

_LINK_ERRORS = ("bad_crc", "bad_encoding", "bad_size", "overruns")
_U16 = 1 << 16


class Counters:
    """Counters by the names of `counters_reply`; they wrap only when they are read."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def count(self, name: str, number: int = 1) -> None:
        """So many more of `name`."""
        self._counts[name] += number

    def count_framing_error(self, error: FramingError) -> None:
        """One more frame that is none."""
        self._counts[error.value] += 1

    @property
    def link_errors(self) -> int:
        """Sum of what went wrong on the way to the board, wrapping."""
        return sum(self._counts[name] for name in _LINK_ERRORS) % _U16

    def to_reply(self) -> CountersReply:
        """All counters, wrapped to their width on the wire."""
        return CountersReply(
            **{
                field.name: self._counts[field.name] % (field.maximum + 1)
                for field in CountersReply.FIELDS
            }
        )
