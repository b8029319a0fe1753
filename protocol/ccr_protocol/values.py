"""What a single value of a spec may be."""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

_U32_MAX = (1 << 32) - 1
_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_PAYLOAD_MEMBERS = frozenset({"pack", "unpack", "first_out_of_range", "inconsistent_axis"})
_CPP_KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
        auto bool case char const default delete do double enum explicit extern float friend goto
        inline int long mutable namespace new operator private protected public register short
        signed sizeof static struct switch template this throw typedef union unsigned using virtual
        void volatile
        """,
    )
)


@dataclass(frozen=True)
class IntegerType:
    """An integer as it goes over the wire, little-endian."""

    name: str
    size: int
    signed: bool

    @property
    def minimum(self) -> int:
        """Least value the type holds."""
        return -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def maximum(self) -> int:
        """Greatest value the type holds."""
        return (1 << (8 * self.size - self.signed)) - 1

    def holds(self, value: int) -> bool:
        """Tell whether the value fits."""
        return self.minimum <= value <= self.maximum


INTEGER_TYPES = {
    f"{letter}{8 * size}": IntegerType(f"{letter}{8 * size}", size, signed=letter == "i")
    for size in (1, 2, 4)
    for letter in "ui"
}


def _is_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no snake_case name")
    if keyword.iskeyword(name) or name in _CPP_KEYWORDS | _PAYLOAD_MEMBERS:
        raise ValueError(f"the name {name!r} is taken by Python, C++ or the generator")
    return name


def _in_one_line(text: str) -> str:
    words = " ".join(text.split())
    if not words:
        raise ValueError("must be a text that is not empty")
    if not (words.isascii() and words.isprintable()) or '"' in words or "\\" in words:
        raise ValueError(
            'must be printable ASCII without " and \\, which would end a comment or string'
        )
    return words


def _integer_type(name: object) -> IntegerType:
    if not isinstance(name, str) or name not in INTEGER_TYPES:
        raise ValueError(f"{name!r} is not one of {', '.join(INTEGER_TYPES)}")
    return INTEGER_TYPES[name]


def _is_unsigned(kind: IntegerType) -> IntegerType:
    if kind.signed:
        raise ValueError(f"{kind.name} is signed")
    return kind


def _is_positive(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise ValueError(f"must be a number above 0, not {value!r}")
    return value


def _is_not_empty(items: tuple[object, ...]) -> tuple[object, ...]:
    if not items:
        raise ValueError("must not be empty")
    return items


def _is_requirement_id(text: str) -> str:
    if not re.fullmatch(r"[A-Z]{3}-[1-9][0-9]*", text):
        raise ValueError(f"{text!r} is not like FRM-1")
    return text


Name = Annotated[str, AfterValidator(_is_name)]
"""A name in snake_case that is no keyword of either language."""
Prose = Annotated[str, AfterValidator(_in_one_line)]
"""Text that may stand in comments and strings of both languages."""
Type = Annotated[IntegerType, BeforeValidator(_integer_type)]
Unsigned = Annotated[Type, AfterValidator(_is_unsigned)]
RequirementId = Annotated[str, AfterValidator(_is_requirement_id)]
Scale = Annotated[int | float, BeforeValidator(_is_positive)]
NotEmpty = AfterValidator(_is_not_empty)
U8 = Annotated[int, Field(ge=0, le=255, strict=True)]
U16 = Annotated[int, Field(ge=0, le=65535, strict=True)]
Axes = Annotated[int, Field(ge=1, le=16, strict=True)]
Count = Annotated[int, Field(ge=2, le=16, strict=True)] | Literal["axes"]
"""Number of elements, or one for each axis of the board."""
Payload = Annotated[int, Field(ge=1, le=249, strict=True)]
"""Bytes; with id, sequence number and CRC below 254, so that COBS adds exactly one."""
Baud = Annotated[int, Field(ge=1, le=_U32_MAX, strict=True)]
Number = Annotated[int, Field(ge=-(1 << 31), le=_U32_MAX, strict=True)]
"""What any of the integer types holds."""
