"""What a spec says: the shape of `spec.toml`, and what each part of it offers the generators.

What the parts must be to each other is checked in `meaning`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, PrivateAttr, StrictBool
from pydantic import Field as Key

from ccr_protocol.consistency import Clause, parse
from ccr_protocol.values import (
    INTEGER_TYPES,
    U8,
    U16,
    Axes,
    Baud,
    Count,
    Name,
    NotEmpty,
    Number,
    Payload,
    Prose,
    RequirementId,
    Scale,
    Type,
    Unsigned,
)

FRAME_OVERHEAD = 4
"""Id, sequence number and the two bytes of the CRC."""

REPLY_BIT = 0x80
"""Added to a request's id for the reply that belongs to it alone."""

ANY_STATE = ("any",)
"""Stands for all states in a request's list of states."""

CAPABILITIES = "capabilities"
"""The flags in `hello_reply` that tell which optional messages a board knows."""

FIRST_CONFIGURATION = ("limits", "slew", "watchdog", "calibration")
"""Structs in an EEPROM slot where a spec does not say which, in this order."""

SLOT_HEADER = ("u16", "u8", "u16")
"""Magic, layout and generation, before the configuration in an EEPROM slot."""

SLOT_TRAILER = ("u32",)
"""The CRC-32, after it."""

SLOT_FRAMING = sum(INTEGER_TYPES[name].size for name in SLOT_HEADER + SLOT_TRAILER)
"""Bytes of a slot besides the configuration."""


PER_AXIS = "axes"
"""The count of a field that has one element for each axis of the board."""

REFERENCE_AXES = 2
"""Axes of a board of the first versions, which could have no others; `Spec.at` gives others."""


def _listed(states: object) -> object:
    return ANY_STATE if states == "any" else states


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Protocol(_Part):
    """The protocol itself, and the firmware that speaks it."""

    name: Name
    version: Annotated[int, Key(ge=1, le=255, strict=True)]
    firmware_version: tuple[U8, U8, U8]
    small_axes: Axes = REFERENCE_AXES
    """A board with more axes than these is a large one."""
    max_axes: Axes = REFERENCE_AXES
    prose: Prose


class Constant(_Part):
    """A number fixed in every implementation, perhaps another one on large boards."""

    name: Name
    value: Number
    large: Number | None = None
    unit: Prose
    prose: Prose


class Enumerator(_Part):
    """One value of an enumeration."""

    name: Name
    value: Number
    prose: Prose


class Enumeration(_Part):
    """A closed set of values; an `internal` one never goes over the wire."""

    name: Name
    type: Unsigned
    prose: Prose
    values: Annotated[tuple[Enumerator, ...], NotEmpty]
    internal: StrictBool = False

    @property
    def numbers(self) -> dict[str, int]:
        """Values by name."""
        return {value.name: value.value for value in self.values}


class Bit(_Part):
    """One bit of a flag set."""

    name: Name
    bit: Annotated[int, Key(ge=0, le=31, strict=True)]
    prose: Prose


class FlagSet(_Part):
    """Independent bits in one integer; bits without a name are sent as 0 and ignored."""

    name: Name
    type: Unsigned
    prose: Prose
    bits: Annotated[tuple[Bit, ...], NotEmpty]

    @property
    def numbers(self) -> dict[str, int]:
        """Bits by name."""
        return {bit.name: bit.bit for bit in self.bits}


class Field(_Part):
    """One field of a payload: `count` integers of one type."""

    name: Name
    type: Type
    prose: Prose
    given_count: Count = Key(1, alias="count")
    unit: Prose = ""
    scale: Scale = 1
    minimum: Number | None = Key(None, alias="min")
    maximum: Number | None = Key(None, alias="max")
    enum: Name | None = None
    flags: Name | None = None

    _axes: int = PrivateAttr(REFERENCE_AXES)

    @property
    def is_per_axis(self) -> bool:
        """Whether it has one element for each axis of the board."""
        return self.given_count == PER_AXIS

    @property
    def is_array(self) -> bool:
        """Whether it is a list of integers, perhaps of one."""
        return self.given_count != 1

    @property
    def count(self) -> int:
        """Number of integers."""
        return self._axes if isinstance(self.given_count, str) else self.given_count

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


class Struct(_Part):
    """A list of fields that several messages share."""

    name: Name
    prose: Prose
    fields: Annotated[tuple[Field, ...], NotEmpty]
    consistency: Annotated[tuple[Clause, ...], BeforeValidator(parse)] = Key((), alias="consistent")

    @property
    def attribute(self) -> str:
        """Name it has inside a message: `state_report` is its `report`."""
        return self.name.rpartition("_")[2]

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return sum(field.size for field in self.fields)


class Size(NamedTuple):
    """Bytes of fields on any board."""

    fixed: int
    per_axis: int

    @classmethod
    def of(cls, fields: Iterable[Field]) -> Self:
        """Bytes of these fields."""
        sizes = [(field.size, 0) for field in fields if not field.is_per_axis]
        sizes += [(0, field.type.size) for field in fields if field.is_per_axis]
        return cls(sum(fixed for fixed, _ in sizes), sum(each for _, each in sizes))


class RequestRules(NamedTuple):
    """How the board treats a request."""

    reply: str
    retry: str
    session: bool
    states: tuple[str, ...]


class Message(_Part):
    """One message: its own fields, then those of its struct. `rules` only on requests."""

    id: U8
    name: Name
    prose: Prose
    optional: Name | None = None
    """The capability of the boards that know the message, if not all do."""
    fields: tuple[Field, ...] = ()
    struct_name: Name | None = Key(None, alias="struct")
    _struct: Struct | None = PrivateAttr(None)
    _states: tuple[str, ...] = PrivateAttr(())

    @property
    def struct(self) -> Struct | None:
        """The struct whose fields follow the message's own, if any."""
        return self._struct

    @property
    def rules(self) -> RequestRules | None:
        """How the board treats it, if it is a request."""
        return None

    @property
    def wire_fields(self) -> tuple[Field, ...]:
        """All fields in the order of the payload."""
        return self.fields + (self.struct.fields if self.struct else ())

    @property
    def size(self) -> int:
        """Bytes of the payload."""
        return sum(field.size for field in self.wire_fields)


class Report(Message):
    """A message to the host."""

    direction: Literal["to_host"]


class Request(Message):
    """A message to the board."""

    direction: Literal["to_board"]
    id: Annotated[int, Key(ge=0, lt=REPLY_BIT, strict=True)]
    reply: Name
    retry: Literal["repeat", "once", "never"]
    session: StrictBool
    states: Annotated[tuple[Name, ...], NotEmpty, BeforeValidator(_listed)]

    @property
    def rules(self) -> RequestRules:
        return RequestRules(self.reply, self.retry, self.session, self._states)


AnyMessage = Annotated[Report | Request, Key(discriminator="direction")]


class Transitions(_Part):
    """Arrows of the state machine with one event and one end."""

    sources: Annotated[tuple[Name, ...], NotEmpty] = Key(alias="from")
    event: Name
    target: Name = Key(alias="to")


class StateMachine(_Part):
    """How events lead from state to state."""

    transitions: Annotated[tuple[Transitions, ...], NotEmpty]


class Transition(NamedTuple):
    """One arrow of the state machine."""

    source: str
    event: str
    target: str


class Framing(_Part):
    """How a message becomes bytes."""

    baud: Baud
    baud_fallback: Baud
    encoding: Literal["COBS"]
    delimiter: Literal[0]
    crc: Literal["CRC-16/X-25"]
    max_payload: Payload
    max_payload_large: Payload | None = None
    prose: Prose

    @property
    def max_decoded(self) -> int:
        """Longest frame before encoding, in bytes."""
        return self.max_payload + FRAME_OVERHEAD

    @property
    def max_encoded(self) -> int:
        """Longest frame on the wire, in bytes: COBS adds one code byte to less than 255."""
        return self.max_decoded + 1


class Eeprom(_Part):
    """Where the board keeps its configuration."""

    prose: Prose
    size: Annotated[int, Key(ge=1, le=65536, strict=True)]
    slot_a: U16
    slot_b: U16
    slot_b_large: U16 | None = None
    boot_counter: U16
    boot_counters: Annotated[int, Key(ge=1, le=255, strict=True)] = 1
    magic: U16
    layout: U8
    configuration: Annotated[tuple[Name, ...], NotEmpty] = FIRST_CONFIGURATION
    _slot_size: int = PrivateAttr(0)

    @property
    def slot_size(self) -> int:
        """Bytes of a slot."""
        return self._slot_size


class Requirement(_Part):
    """A testable sentence with a name."""

    id: RequirementId
    text: Prose


class Spec(_Part):
    """The whole protocol."""

    protocol: Protocol
    framing: Framing
    constants: Annotated[tuple[Constant, ...], NotEmpty] = Key(alias="constant")
    enums: Annotated[tuple[Enumeration, ...], NotEmpty] = Key(alias="enum")
    flag_sets: Annotated[tuple[FlagSet, ...], NotEmpty] = Key(alias="flags")
    structs: Annotated[tuple[Struct, ...], NotEmpty] = Key(alias="struct")
    messages: Annotated[tuple[AnyMessage, ...], NotEmpty] = Key(alias="message")
    state_machine: StateMachine
    eeprom: Eeprom
    requirements: Annotated[tuple[Requirement, ...], NotEmpty] = Key(alias="requirement")
    _hash: int = PrivateAttr(0)
    _axes: int = PrivateAttr(REFERENCE_AXES)

    def model_post_init(self, tree: Any) -> None:  # noqa: ANN401
        """Tell messages and EEPROM of the structs and states that they name."""
        structs = {struct.name: struct for struct in self.structs}
        for message in self.messages:
            message._struct = structs.get(message.struct_name or "")
            if isinstance(message, Request):
                any_state = message.states == ANY_STATE
                message._states = self.enumerator_names("state") if any_state else message.states
        self._measure_slot()

    def _measure_slot(self) -> None:
        self.eeprom._slot_size = SLOT_FRAMING + sum(field.size for field in self.saved_fields)

    def at(self, axes: int) -> Self:
        """The protocol of a board with so many axes: each count and limit is that board's."""
        spec = self.model_copy(deep=True)
        spec._axes = axes
        for one in (*spec.structs, *spec.messages):
            for field in one.fields:
                field._axes = axes
        large: dict[_Part, dict[str, int | None]] = {
            spec.framing: {"max_payload": spec.framing.max_payload_large},
            spec.eeprom: {"slot_b": spec.eeprom.slot_b_large},
            **{constant: {"value": constant.large} for constant in spec.constants},
        }
        if axes > spec.protocol.small_axes:
            for part, values in large.items():
                for name, value in values.items():
                    if value is not None:
                        part.__dict__[name] = value
        spec._measure_slot()
        return spec

    @property
    def axes(self) -> int:
        """Axes of the board that counts and limits are for."""
        return self._axes

    @property
    def saved_fields(self) -> tuple[Field, ...]:
        """Fields of the configuration in an EEPROM slot, in their order."""
        structs = {struct.name: struct.fields for struct in self.structs}
        return tuple(f for name in self.eeprom.configuration for f in structs.get(name, ()))

    @property
    def version(self) -> int:
        """Version of the protocol that the spec describes."""
        return self.protocol.version

    @property
    def optional_capabilities(self) -> frozenset[str]:
        """Capabilities that stand for messages which not all boards know."""
        return frozenset(message.optional for message in self.messages if message.optional)

    @property
    def firmware_version(self) -> tuple[int, int, int]:
        """Major, minor and patch."""
        return self.protocol.firmware_version

    @property
    def prose(self) -> str:
        """What the protocol is for."""
        return self.protocol.prose

    @property
    def hash(self) -> int:
        """Fingerprint, by which the two ends notice that they were built from different specs."""
        return self._hash

    @cached_property
    def transitions(self) -> tuple[Transition, ...]:
        """All arrows of the state machine."""
        rows = self.state_machine.transitions
        return tuple(
            Transition(source, row.event, row.target) for row in rows for source in row.sources
        )

    @cached_property
    def enum_by_name(self) -> dict[str, Enumeration]:
        """Enumerations by name."""
        return {enum.name: enum for enum in self.enums}

    @cached_property
    def message_by_name(self) -> dict[str, Report | Request]:
        """Messages by name."""
        return {message.name: message for message in self.messages}

    @property
    def requests(self) -> tuple[Request, ...]:
        """Messages to the board."""
        return tuple(message for message in self.messages if isinstance(message, Request))

    def enumerator_names(self, enum: str) -> tuple[str, ...]:
        """Names of the values of an enumeration, in the spec's order; none if missing."""
        return tuple(value.name for one in self.enums if one.name == enum for value in one.values)
