"""What all payloads have in common. The messages themselves are generated into `messages`."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self, TypeVar

from ccr_host.core.errors import CcrError

E = TypeVar("E", bound=IntEnum)

_OTHER_SPEC = "build host and firmware from the same spec"


class PayloadError(CcrError):
    """Values that do not fit their integers, or bytes that are no such payload."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field on the wire: `count` integers; a physical value is raw * scale, in `unit`."""

    name: str
    code: str
    """Of the integer, as in the `struct` module."""
    minimum: int
    maximum: int
    count: int = 1
    unit: str = ""
    scale: float = 1

    def fits(self, elements: tuple[object, ...]) -> bool:
        """Tell whether the integers fit the wire, in range or not."""
        try:
            struct.pack(f"<{self.count}{self.code}", *elements)
        except struct.error:
            return False
        return True

    @property
    def needs(self) -> str:
        """What fits, in words."""
        bits = 8 * struct.calcsize(f"<{self.code}")
        lower = 0 if self.code.isupper() else -(1 << (bits - 1))
        integers = f"{self.count} integers" if self.count > 1 else "an integer"
        return f"{integers} from {lower} to {lower + (1 << bits) - 1}"


class Payload(ABC):
    """A fixed list of integers."""

    __slots__ = ()

    NAME: ClassVar[str]
    SIZE: ClassVar[int]
    FIELDS: ClassVar[tuple[Field, ...]]
    """Its own fields; those of the nested struct follow them on the wire."""
    LAYOUT: ClassVar[struct.Struct]
    """Of its own fields."""
    NESTED: ClassVar[str | None] = None
    """Attribute that holds the struct."""

    def pack(self) -> bytes:
        """Little-endian bytes.

        Raises:
            PayloadError: names the field whose value does not fit its integer type.
        """
        own = [(field, _elements(getattr(self, field.name))) for field in self.FIELDS]
        try:
            if any(len(elements) != field.count for field, elements in own):
                raise struct.error
            packed = self.LAYOUT.pack(*(number for _, elements in own for number in elements))
        except struct.error:
            raise self._misfit() from None
        nested = self._nested()
        return packed if nested is None else packed + nested.pack()

    @classmethod
    @abstractmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read little-endian bytes; ranges are not checked.

        Raises:
            PayloadError: wrong length, or a value that its enumeration does not have.
        """

    def first_out_of_range(self) -> int | None:
        """Index of the first field out of its range; an array is one field."""
        for index, (field, elements) in enumerate(self._fields_with_elements()):
            if not all(field.minimum <= element <= field.maximum for element in elements):
                return index
        return None

    def inconsistent_axis(self) -> int | None:
        """Index of the first axis whose fields, each in range, contradict each other."""
        nested = self._nested()
        return None if nested is None else nested.inconsistent_axis()

    def _nested(self) -> Payload | None:
        return None if self.NESTED is None else getattr(self, self.NESTED)

    def _fields_with_elements(self) -> Iterator[tuple[Field, tuple[int, ...]]]:
        for field in self.FIELDS:
            yield field, _elements(getattr(self, field.name))
        nested = self._nested()
        if nested is not None:
            yield from nested._fields_with_elements()

    def _misfit(self) -> PayloadError:
        for field in self.FIELDS:
            value = getattr(self, field.name)
            if not field.fits(_elements(value)):
                place = f"{self.NAME}.{field.name}"
                return PayloadError(
                    f"{place} = {value} does not fit the wire", f"give {field.needs}"
                )
        raise AssertionError(f"every field of {self} fits")

    @classmethod
    def _numbers(cls, payload: bytes) -> tuple[Any, ...]:
        """Of its own fields, from a payload of exactly the right length."""
        if len(payload) != cls.SIZE:
            cause = f"{cls.NAME} with {len(payload)} instead of {cls.SIZE} bytes"
            raise PayloadError(cause, _OTHER_SPEC)
        return cls.LAYOUT.unpack_from(payload)

    @classmethod
    def _enumerator(cls, field: str, enum: type[E], number: int) -> E:
        try:
            return enum(number)
        except ValueError:
            cause = f"{cls.NAME}.{field} = {number} is no {enum.__name__}"
            raise PayloadError(cause, _OTHER_SPEC) from None


def _elements(value: Any) -> tuple[Any, ...]:  # noqa: ANN401 - judged by its type
    return value if isinstance(value, tuple) else (value,)
