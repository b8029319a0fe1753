"""Makes the typed Python module. Its text is already as `ruff format` would leave it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import (
    FRAME_OVERHEAD,
    SLOT_FRAMING,
    Enumeration,
    Field,
    FlagSet,
    Message,
    Size,
    Spec,
    Struct,
)

_WIDTH = 100
_LONGEST_SPELT_OUT = 4
"""Longer arrays are tuples of any length to the type checker."""
_SENTENCE_END = re.compile(r"(?<=[.?!]) ")
_STRUCT_CODE = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}

_HEADER = '''"""Messages of the wire protocol. Generated from protocol/spec.toml: do not edit."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag
from types import MappingProxyType
from typing import ClassVar, Final

from ccr_host.link import payload
from ccr_host.link.payload import AXES, BySize, Message, Payload, PayloadError, by_id, nested, wire

__all__ = ["Message", "Payload", "PayloadError"]  # re-exported; all else is public as it stands
'''

_REQUEST = '''
class Request(payload.Request):
    """A message to the board, and how the board treats it."""

    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)


class SessionRequest(Request):
    """A request that the board takes from the host of the open session alone."""

    NEEDS_SESSION = True

    session: int = wire("H", 0, 65535)
    """The open session."""
'''


def generate(spec: Spec) -> str:
    """Text of `ccr_host/link/messages.py`."""
    blocks: list[str] = [_HEADER, _constants(spec)]
    blocks += [_enumeration(enum) for enum in spec.enums]
    blocks += [_flag_set(flags) for flags in spec.flag_sets]
    blocks += [_struct_class(struct) for struct in spec.structs]
    blocks += [_REQUEST]
    blocks += [_message_class(message, spec) for message in spec.messages]
    blocks += [_tables(spec)]
    return "\n\n".join(block.strip("\n") + "\n" for block in blocks)


def class_name(name: str) -> str:
    """`set_target` becomes `SetTarget`."""
    return "".join(part.capitalize() for part in name.split("_"))


def _constants(spec: Spec) -> str:
    framing, eeprom = spec.framing, spec.eeprom
    small = spec.protocol.small_axes
    saved = Size.of(spec.saved_fields)

    def figure(value: object, large: object) -> str:
        return str(value) if large is None else f"BySize({value}, {large}, {small})"

    numbers = {
        "BAUD": framing.baud,
        "BAUD_FALLBACK": framing.baud_fallback,
        "FRAME_DELIMITER": framing.delimiter,
        "FRAME_OVERHEAD": FRAME_OVERHEAD,
        "MAX_AXES": spec.protocol.max_axes,
        "MAX_PAYLOAD": figure(framing.max_payload, framing.max_payload_large),
    }
    slot = {
        "EEPROM_SIZE": eeprom.size,
        "EEPROM_SLOT_A": eeprom.slot_a,
        "EEPROM_SLOT_B": figure(eeprom.slot_b, eeprom.slot_b_large),
        "EEPROM_BOOT_COUNTER": eeprom.boot_counter,
        "EEPROM_BOOT_COUNTERS": eeprom.boot_counters,
    }
    lines = [
        f"PROTOCOL_VERSION: Final = {spec.version}",
        f"SPEC_HASH: Final = 0x{spec.hash:08X}",
        f"FIRMWARE_VERSION: Final = {spec.firmware_version}",
        "",
        *(f"{name}: Final = {value}" for name, value in numbers.items()),
        "",
    ]
    for constant in spec.constants:
        lines.append(f"{constant.name.upper()}: Final = {figure(constant.value, constant.large)}")
        lines.extend(_docstring(f"{constant.prose} [{constant.unit}]", ""))
    lines += ["", *(f"{name}: Final = {value}" for name, value in slot.items())]
    lines += [
        f"EEPROM_MAGIC: Final = 0x{eeprom.magic:04X}",
        f"EEPROM_LAYOUT: Final = {eeprom.layout}",
        "",
        "",
        "def eeprom_slot_size(axes: int) -> int:",
        '    """Bytes of an EEPROM slot."""',
        f"    return {saved.fixed + SLOT_FRAMING} + {saved.per_axis} * axes",
    ]
    return "\n".join(lines)


def _enumeration(enum: Enumeration) -> str:
    lines = [
        f"class {class_name(enum.name)}(IntEnum):",
        *_class_docstring(enum.name, enum.prose),
        "",
    ]
    for value in enum.values:
        lines.append(f"    {value.name.upper()} = {value.value}")
        lines.extend(_docstring(value.prose, "    "))
    return "\n".join(lines)


def _flag_set(flags: FlagSet) -> str:
    lines = [
        f"class {class_name(flags.name)}(IntFlag):",
        *_class_docstring(flags.name, flags.prose),
        "",
    ]
    for bit in flags.bits:
        lines.append(f"    {bit.name.upper()} = 0x{1 << bit.bit:02X}")
        lines.extend(_docstring(bit.prose, "    "))
    return "\n".join(lines)


def _struct_class(struct: Struct) -> str:
    lines = list(_class_head(struct, "Payload", [f'name="{struct.name}"']))
    if struct.consistency:
        lines += ["", *_inconsistent_axis(struct)]
    return "\n".join(lines)


def _message_class(message: Message, spec: Spec) -> str:
    arguments = [f'name="{message.name}"', f"number=0x{message.id:02X}"]
    if message.optional:
        arguments.append(f"capability=Capabilities.{message.optional.upper()}")
    rules = message.rules
    if not rules:
        return "\n".join(_class_head(message, "Message", arguments))
    arguments += [f"reply=0x{spec.message_by_name[rules.reply].id:02X}", f'retry="{rules.retry}"']
    base = "SessionRequest" if rules.session else "Request"
    states = "".join(_allowed_states(rules.states, spec))
    return "\n".join(_class_head(message, base, arguments, states))


def _class_head(
    owner: Struct | Message, base: str, arguments: Sequence[str], constant: str = ""
) -> Iterator[str]:
    head = f"class {class_name(owner.name)}"
    inside = ", ".join([base, *arguments])
    if len(head) + len(inside) + 3 <= _WIDTH:
        yield f"{head}({inside}):"
    elif len(inside) + 4 <= _WIDTH:
        yield from (f"{head}(", f"    {inside}", "):")
    else:
        yield from (f"{head}(", *(f"    {one}," for one in (base, *arguments)), "):")
    yield from _class_docstring(owner.name, owner.prose)
    nested = owner.struct if isinstance(owner, Message) else None
    fields = owner.fields[1:] if base == "SessionRequest" else owner.fields
    if constant:
        yield from ("", f"    {constant}")
    if fields or nested:
        yield ""
    for field in fields:
        yield f"    {field.name}: {_annotation(field)} = wire({', '.join(_wire(field))})"
        yield from _docstring(field.prose, "    ")
    if nested:
        name = class_name(nested.name)
        yield f"    {nested.attribute}: {name} = nested({name})"


def _annotation(field: Field) -> str:
    element = class_name(field.enum or field.flags or "") or "int"
    if not field.is_array:
        return element
    if field.is_per_axis or field.count > _LONGEST_SPELT_OUT:
        return f"tuple[{element}, ...]"
    return f"tuple[{', '.join([element] * field.count)}]"


def _wire(field: Field) -> Iterator[str]:
    yield f'"{_STRUCT_CODE[field.type.name]}"'
    yield str(field.lower)
    yield str(field.upper)
    if field.unit:
        yield f'"{field.unit}"'
    if field.scale != 1:
        yield f"{field.scale}" if field.unit else f"scale={field.scale}"
    if field.is_array:
        yield f"count={'AXES' if field.is_per_axis else field.count}"
    if field.enum or field.flags:
        yield f"of={class_name(field.enum or field.flags or '')}"


def _allowed_states(states: Sequence[str], spec: Spec) -> Iterator[str]:
    """Nothing where all are allowed, as then the base class says so."""
    refused = [name for name in spec.enumerator_names("state") if name not in states]
    if not refused:
        return
    if len(refused) < len(states):
        yield f"ALLOWED_STATES = frozenset(State) - {_state_set(refused)}"
    else:
        yield f"ALLOWED_STATES = frozenset({_state_set(states)})"


def _state_set(names: Iterable[str]) -> str:
    return "{" + ", ".join(f"State.{name.upper()}" for name in names) + "}"


def _inconsistent_axis(struct: Struct) -> Iterator[str]:
    yield "    def inconsistent_axis(self) -> int | None:"
    yield f"        for axis in range(len(self.{struct.fields[0].name})):"
    yield "            consistent = ("
    for index, clause in enumerate(struct.consistency):
        yield f"                {'and ' if index else ''}{_clause(clause)}"
    yield "            )"
    yield "            if not consistent:"
    yield "                return axis"
    yield "        return None"


def _clause(clause: Clause) -> str:
    if isinstance(clause, Comparison):
        return f"self.{clause.left}[axis] {clause.operator} self.{clause.right}[axis]"
    return f"self.{clause.field}[axis] not in range({clause.first}, {clause.last + 1})"


def _tables(spec: Spec) -> str:
    lines = ["MESSAGES: Final[Mapping[int, type[Message]]] = by_id(globals(), Message)"]
    lines += ["REQUESTS: Final[Mapping[int, type[Request]]] = by_id(globals(), Request)", ""]
    lines += ["TRANSITIONS: Final[Mapping[tuple[State, Event], State]] = MappingProxyType("]
    lines += ["    {"]
    lines += [
        f"        (State.{t.source.upper()}, Event.{t.event.upper()}): State.{t.target.upper()},"
        for t in spec.transitions
    ]
    lines += ["    }", ")", '"""What is not listed changes nothing."""']
    return "\n".join(lines)


def _class_docstring(name: str, prose: str) -> list[str]:
    """Put the first sentence alone on the first line, as linters want it."""
    indent = "    "
    if len(f'{indent}"""{prose}"""') <= _WIDTH:
        return [f'{indent}"""{prose}"""']
    summary, *rest = _SENTENCE_END.split(prose, maxsplit=1)
    if len(f'{indent}"""{summary}') > _WIDTH:
        summary, rest = f"Payload of `{name}`.", [prose]
    body = textwrap.wrap(" ".join(rest), _WIDTH, initial_indent=indent, subsequent_indent=indent)
    return [f'{indent}"""{summary}', "", *body, f'{indent}"""']


def _docstring(text: str, indent: str) -> list[str]:
    quoted = f'"""{text}"""'
    return textwrap.wrap(quoted, _WIDTH, initial_indent=indent, subsequent_indent=indent)
