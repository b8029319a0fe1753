"""What a valid spec says, as data. Built from a tree that `validate` has passed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ccr_protocol.consistency import Clause

FRAME_OVERHEAD = 4
"""Id, sequence number and the two bytes of the CRC."""

REPLY_BIT = 0x80
"""Added to a request's id for the reply that belongs to it alone."""


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


@dataclass(frozen=True)
class Constant:
    """A number fixed in every implementation."""

    name: str
    value: int
    unit: str
    prose: str


@dataclass(frozen=True)
class Enumerator:
    """One value of an enumeration."""

    name: str
    value: int
    prose: str


@dataclass(frozen=True)
class Enumeration:
    """A closed set of values; an `internal` one never goes over the wire."""

    name: str
    type: IntegerType
    prose: str
    values: tuple[Enumerator, ...]
    internal: bool = False


@dataclass(frozen=True)
class Bit:
    """One bit of a flag set."""

    name: str
    bit: int
    prose: str


@dataclass(frozen=True)
class FlagSet:
    """Independent bits in one integer; bits without a name are sent as 0 and ignored."""

    name: str
    type: IntegerType
    prose: str
    bits: tuple[Bit, ...]


@dataclass(frozen=True)
class Field:
    """One field of a payload: `count` integers of one type."""

    name: str
    type: IntegerType
    prose: str
    count: int = 1
    unit: str = ""
    scale: float = 1
    minimum: int | None = None
    maximum: int | None = None
    enum: str | None = None
    flags: str | None = None

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return self.type.size * self.count

    @property
    def unit_text(self) -> str:
        """What one step of the integer is worth."""
        return self.unit if self.scale == 1 else f"{self.scale:g} {self.unit}"

    @property
    def description(self) -> str:
        """Prose, unit and range."""
        notes = [self.prose]
        if self.unit:
            notes.append(f"[{self.unit_text}]")
        if self.minimum is not None or self.maximum is not None:
            notes.append(f"{self.lower} to {self.upper}.")
        return " ".join(notes)

    @property
    def lower(self) -> int:
        """Least value in range."""
        return self.type.minimum if self.minimum is None else self.minimum

    @property
    def upper(self) -> int:
        """Greatest value in range."""
        return self.type.maximum if self.maximum is None else self.maximum


@dataclass(frozen=True)
class Struct:
    """A list of fields that several messages share."""

    name: str
    prose: str
    fields: tuple[Field, ...]
    consistency: tuple[Clause, ...] = ()

    @property
    def attribute(self) -> str:
        """Name it has inside a message: `state_report` is its `report`."""
        return self.name.rpartition("_")[2]

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return sum(field.size for field in self.fields)


@dataclass(frozen=True)
class RequestRules:
    """How the board treats a request."""

    reply: str
    retry: str
    session: bool
    states: tuple[str, ...]


@dataclass(frozen=True)
class Message:
    """One message: its own fields, then those of its struct. `rules` only on requests."""

    id: int
    name: str
    prose: str
    fields: tuple[Field, ...]
    struct: Struct | None
    rules: RequestRules | None

    @property
    def wire_fields(self) -> tuple[Field, ...]:
        """All fields in the order of the payload."""
        return self.fields + (self.struct.fields if self.struct else ())

    @property
    def size(self) -> int:
        """Bytes of the payload."""
        return sum(field.size for field in self.wire_fields)


@dataclass(frozen=True)
class Transition:
    """One arrow of the state machine."""

    source: str
    event: str
    target: str


@dataclass(frozen=True)
class Framing:
    """How a message becomes bytes."""

    baud: int
    baud_fallback: int
    encoding: str
    delimiter: int
    crc: str
    max_payload: int
    prose: str

    @property
    def max_decoded(self) -> int:
        """Longest frame before encoding, in bytes."""
        return self.max_payload + FRAME_OVERHEAD

    @property
    def max_encoded(self) -> int:
        """Longest frame on the wire, in bytes: COBS adds one code byte to less than 255."""
        return self.max_decoded + 1


@dataclass(frozen=True)
class Eeprom:
    """Where the board keeps its configuration."""

    prose: str
    size: int
    slot_a: int
    slot_b: int
    boot_counter: int
    boot_counters: int
    magic: int
    layout: int
    configuration: tuple[str, ...]
    slot_size: int


@dataclass(frozen=True)
class Requirement:
    """A testable sentence with a name."""

    id: str
    text: str


@dataclass(frozen=True)
class Spec:
    """The whole protocol."""

    name: str
    version: int
    firmware_version: tuple[int, int, int]
    prose: str
    framing: Framing
    constants: tuple[Constant, ...]
    enums: tuple[Enumeration, ...]
    flag_sets: tuple[FlagSet, ...]
    structs: tuple[Struct, ...]
    messages: tuple[Message, ...]
    transitions: tuple[Transition, ...]
    eeprom: Eeprom
    requirements: tuple[Requirement, ...]
    hash: int

    @cached_property
    def enum_by_name(self) -> dict[str, Enumeration]:
        """Enumerations by name."""
        return {enum.name: enum for enum in self.enums}

    @cached_property
    def message_by_name(self) -> dict[str, Message]:
        """Messages by name."""
        return {message.name: message for message in self.messages}

    @property
    def requests(self) -> tuple[Message, ...]:
        """Messages to the board."""
        return tuple(message for message in self.messages if message.rules)

    def enumerator_names(self, enum: str) -> tuple[str, ...]:
        """Names of the values of an enumeration, in the order of the spec."""
        return tuple(value.name for value in self.enum_by_name[enum].values)
