"""The small language of `consistent` rules.

A rule reads `a < b and a <= c <= b and d not in -99..99, for each axis`: comparisons of fields
of one struct, and forbidden spans, each of which must hold for every element of the fields.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeAlias

_SUFFIX = ", for each axis"
_COMPARISON = re.compile(r"\w+(?: (?:<|<=) \w+)+")
_EXCLUSION = re.compile(r"(\w+) not in (-?\d+)\.\.(-?\d+)")


@dataclass(frozen=True)
class Comparison:
    """`left < right`, or `left <= right`."""

    left: str
    operator: str
    right: str

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields it speaks of."""
        return (self.left, self.right)


@dataclass(frozen=True)
class Exclusion:
    """`field not in first..last`, both ends forbidden."""

    field: str
    first: int
    last: int

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields it speaks of."""
        return (self.field,)


Clause: TypeAlias = Comparison | Exclusion


def parse(text: object) -> tuple[Clause, ...]:
    """Read a rule.

    Raises:
        ValueError: the text is not of this language; says where.
    """
    if not isinstance(text, str) or not text.endswith(_SUFFIX):
        raise ValueError(f"must end in {_SUFFIX!r}")
    clauses: list[Clause] = []
    for part in text.removesuffix(_SUFFIX).split(" and "):
        clauses.extend(_parse_clause(part))
    return tuple(clauses)


def _parse_clause(text: str) -> list[Clause]:
    if exclusion := _EXCLUSION.fullmatch(text):
        field, first, last = exclusion.groups()
        return [Exclusion(field, int(first), int(last))]
    if _COMPARISON.fullmatch(text):
        words = text.split(" ")
        return [
            Comparison(words[at], words[at + 1], words[at + 2])
            for at in range(0, len(words) - 2, 2)
        ]
    raise ValueError(f"cannot read {text!r}; write 'a < b', 'a <= b <= c' or 'a not in -9..9'")
