"""What all messages have in common. The messages themselves are generated into `messages`.

A message is a frozen dataclass whose fields are declared with `wire`, and a struct that it holds
after them with `nested`. Each class has one format of the `struct` module for all of it.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum, IntFlag
from functools import cache
from operator import attrgetter
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeVar, dataclass_transform

from ccr_host.core.errors import CcrError

AXES = 0
"""Count of a field that has one element for each axis of the board."""

Retry = Literal["repeat", "once", "never"]
P = TypeVar("P", bound="Payload")
M = TypeVar("M", bound="Message")

_MOST_AXES = 16
_OTHER_SPEC = "build host and firmware from the same spec"


class PayloadError(CcrError):
    """Values do not fit their integers, or bytes are not such a payload."""


@dataclass(frozen=True, slots=True)
class BySize:
    """A figure of the board that depends on whether it is a small one."""

    small: int
    large: int
    small_axes: int

    def of(self, axes: int) -> int:
        """The figure of a board with so many axes."""
        return self.small if axes <= self.small_axes else self.large


@dataclass(frozen=True, slots=True)
class Field:
    """A field on the wire: `count` integers; the physical value in `unit` is raw * scale."""

    name: str
    code: str
    """Type of the integer, as in the `struct` module."""
    minimum: int
    maximum: int
    unit: str = ""
    scale: float = 1
    count: int = 1
    of: type[IntEnum] | type[IntFlag] | None = None
    """Enum or flag type of the integers; None for plain numbers."""

    @property
    def is_array(self) -> bool:
        """Whether its value is a tuple."""
        return self.count != 1

    def count_at(self, axes: int) -> int:
        """Number of integers on a board with so many axes."""
        return self.count or axes

    def fits(self, elements: tuple[object, ...], axes: int) -> bool:
        """Whether the integers fit their type, even if they are out of range."""
        if self.count == AXES and not 1 <= axes <= _MOST_AXES:
            return False
        try:
            struct.pack(f"<{self.count_at(axes)}{self.code}", *elements)
        except struct.error:
            return False
        return True

    @property
    def needs(self) -> str:
        """The values that fit, in words."""
        bits = 8 * struct.calcsize(f"<{self.code}")
        lower = 0 if self.code.isupper() else -(1 << (bits - 1))
        integers = f"{self.count} integers" if self.is_array else "an integer"
        if self.count == AXES:
            integers = "an integer for each axis,"
        return f"{integers} from {lower} to {lower + (1 << bits) - 1}"


def wire(
    code: str,
    minimum: int,
    maximum: int,
    unit: str = "",
    scale: float = 1,
    *,
    count: int = 1,
    of: type[IntEnum] | type[IntFlag] | None = None,
) -> Any:  # noqa: ANN401 - of the type that the field is annotated with
    """Declare a field of a payload; see `Field`."""
    field = Field("", code, minimum, maximum, unit, scale, count, of)
    return dataclasses.field(metadata={"field": field})


def nested(kind: type[P]) -> P:
    """Declare the struct that follows the fields of a message."""
    declared: P = dataclasses.field(metadata={"struct": kind})
    return declared


@dataclass_transform(frozen_default=True, field_specifiers=(wire, nested))
class Payload:
    """Base of all structs of integers; those on the wire have a name."""

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    NAME: ClassVar[str]
    FIELDS: ClassVar[tuple[Field, ...]]
    """The own fields; on the wire those of the nested struct follow them."""
    SIZE: ClassVar[int]
    """Bytes of the fields that are the same on every board."""
    AXIS_SIZE: ClassVar[int]
    """Bytes that each axis of the board adds."""
    _LAYOUTS: ClassVar[dict[int, struct.Struct]]
    """Layouts of all fields, including nested ones, by the number of axes."""
    _VALUES: ClassVar[tuple[tuple[Field, attrgetter[Any]], ...]]
    """All fields, each with the getter of its value."""
    _READERS: ClassVar[tuple[Callable[[int], Any] | None, ...]]
    """The conversion of each own field's integer to an enumerator or flags, if any."""
    NESTED: ClassVar[tuple[str, type[Payload]] | None]
    """Attribute and type of the nested struct, if there is one."""

    def __init_subclass__(cls, *, name: str = "") -> None:
        super().__init_subclass__()
        dataclass(frozen=True)(cls)
        if not name:
            return
        declared = dataclasses.fields(cls)
        own = [one for one in declared if "field" in one.metadata]
        cls.NAME = name
        cls.FIELDS = tuple(replace(one.metadata["field"], name=one.name) for one in own)
        cls._READERS = tuple(None if f.of is None else cache(f.of) for f in cls.FIELDS)
        cls._VALUES = tuple((field, attrgetter(field.name)) for field in cls.FIELDS)
        cls.NESTED = None
        for one in declared[len(own) :]:
            kind = one.metadata["struct"]
            cls.NESTED = one.name, kind
            cls._VALUES += tuple((f, attrgetter(f"{one.name}.{f.name}")) for f in kind.FIELDS)
        cls._LAYOUTS = {
            axes: struct.Struct(
                "<" + "".join(f"{field.count_at(axes)}{field.code}" for field, _ in cls._VALUES)
            )
            for axes in range(_MOST_AXES + 1)
        }
        cls.SIZE = cls._LAYOUTS[0].size
        cls.AXIS_SIZE = cls._LAYOUTS[1].size - cls.SIZE

    @classmethod
    def size(cls, axes: int) -> int:
        return cls.SIZE + axes * cls.AXIS_SIZE

    def pack(self) -> bytes:
        """Little-endian bytes, for a board with as many axes as there are elements.

        Raises:
            PayloadError: names the field whose value does not fit its integer type.
        """
        integers: list[int] = []
        axes = 0
        try:
            for field, value_of in self._VALUES:
                value = value_of(self)
                if field.count == 1:
                    integers.append(value)
                    continue
                if field.count == AXES and not axes:
                    axes = len(value)
                if not value or len(value) != (field.count or axes):
                    raise self._misfit(axes)
                integers += value
            return self._LAYOUTS[axes].pack(*integers)
        except (struct.error, TypeError, KeyError):
            raise self._misfit(axes) from None

    @classmethod
    def unpack(cls, payload: bytes, axes: int | None = None) -> Self:
        """Read little-endian bytes; ranges are not checked.

        ``axes`` of the board are by default those that the length tells.

        Raises:
            PayloadError: wrong length, or a value that its enumeration does not have.
        """
        if axes is None:
            axes = (len(payload) - cls.SIZE) // cls.AXIS_SIZE if cls.AXIS_SIZE else 0
            axes = min(max(axes, 1), _MOST_AXES)
        if len(payload) != cls.size(axes):
            cause = f"{cls.NAME} with {len(payload)} instead of {cls.size(axes)} bytes"
            raise PayloadError(cause, _OTHER_SPEC)
        return cls._of(cls._LAYOUTS[axes].unpack(payload), axes)

    def with_axes(self, axes: int) -> Self:
        """The same for another number of axes: the first ones, or the last one repeated."""
        own = {f.name: getattr(self, f.name) for f in self.FIELDS if f.count == AXES}
        wide = {name: (values + axes * values[-1:])[:axes] for name, values in own.items()}
        return replace(self, **wide)

    def first_out_of_range(self) -> int | None:
        """Index of the first field out of its range; an array is one field."""
        for index, (field, value_of) in enumerate(self._VALUES):
            value = value_of(self)
            for element in value if field.count != 1 else (value,):
                if not field.minimum <= element <= field.maximum:
                    return index
        return None

    def inconsistent_axis(self) -> int | None:
        """Index of the first axis whose fields contradict each other although each is in range."""
        held = self._held()
        return None if held is None else held.inconsistent_axis()

    @classmethod
    def _of(cls, integers: tuple[int, ...], axes: int) -> Self:
        values: list[Any] = []
        at = 0
        for field, reader in zip(cls.FIELDS, cls._READERS, strict=True):
            count = field.count or axes
            if field.count != 1:
                values.append(integers[at : at + count])
            elif reader is None:
                values.append(integers[at])
            else:
                try:
                    values.append(reader(integers[at]))
                except ValueError:
                    raise cls._unknown(field, integers[at]) from None
            at += count
        if cls.NESTED is not None:
            values.append(cls.NESTED[1]._of(integers[at:], axes))
        return cls(*values)

    @classmethod
    def _unknown(cls, field: Field, number: int) -> PayloadError:
        assert field.of is not None
        cause = f"{cls.NAME}.{field.name} = {number} is no {field.of.__name__}"
        return PayloadError(cause, _OTHER_SPEC)

    def _held(self) -> Payload | None:
        return None if self.NESTED is None else getattr(self, self.NESTED[0])

    def _misfit(self, axes: int) -> PayloadError:
        for field in self.FIELDS:
            value = getattr(self, field.name)
            if not field.fits(value if isinstance(value, tuple) else (value,), axes):
                place = f"{self.NAME}.{field.name}"
                return PayloadError(
                    f"{place} = {value} does not fit the wire", f"give {field.needs}"
                )
        held = self._held()
        assert held is not None, f"every field of {self} fits"
        return held._misfit(axes)


class Message(Payload):
    """A payload with an id."""

    ID: ClassVar[int] = 0
    CAPABILITY: ClassVar[int] = 0
    """Bit of the boards that know it, if it is optional; 0 if every board does."""

    def __init_subclass__(cls, *, name: str = "", number: int = 0, capability: int = 0) -> None:
        super().__init_subclass__(name=name)
        cls.ID = number
        cls.CAPABILITY = capability


class Request(Message):
    """A message to the board, and how the board treats it."""

    REPLY_ID: ClassVar[int]
    RETRY: ClassVar[Retry]
    NEEDS_SESSION: ClassVar[bool] = False

    def __init_subclass__(
        cls,
        *,
        name: str = "",
        number: int = 0,
        capability: int = 0,
        reply: int = 0,
        retry: Retry = "never",
    ) -> None:
        super().__init_subclass__(name=name, number=number, capability=capability)
        cls.REPLY_ID = reply
        cls.RETRY = retry


def by_id(namespace: Mapping[str, object], base: type[M]) -> Mapping[int, type[M]]:
    """The messages in a module's namespace, by id."""
    kinds = [one for one in namespace.values() if isinstance(one, type) and issubclass(one, base)]
    return MappingProxyType({kind.ID: kind for kind in kinds if kind.ID})
