"""Makes the typed Python module. Its text is already as `ruff format` would leave it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import Enumeration, Field, FlagSet, Message, Spec, Struct

_WIDTH = 100
_LONGEST_SPELT_OUT = 4
"""Longer arrays are tuples of any length to the type checker."""
_SENTENCE_END = re.compile(r"(?<=[.?!]) ")
_STRUCT_CODE = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}

_HEADER = '''"""Messages of the wire protocol. Generated from protocol/spec.toml: do not edit."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from types import MappingProxyType
from typing import ClassVar, Final, Literal, Self, TypeAlias

from ccr_host.link.payload import Field, Payload, PayloadError

__all__ = ["Payload", "PayloadError"]  # re-exported; all else is public as it stands
'''

_MESSAGE_BASES = '''
Retry: TypeAlias = Literal["repeat", "once", "never"]


class Message(Payload):
    """A payload with an id of its own."""

    __slots__ = ()

    ID: ClassVar[int]


class Request(Message):
    """A message to the board, and how the board treats it."""

    __slots__ = ()

    REPLY_ID: ClassVar[int]
    RETRY: ClassVar[Retry]
    NEEDS_SESSION: ClassVar[bool]
    ALLOWED_STATES: ClassVar[frozenset[State]]
'''


def generate(spec: Spec) -> str:
    """Text of `ccr_host/link/messages.py`."""
    blocks: list[str] = [_HEADER, _constants(spec)]
    blocks += [_enumeration(enum) for enum in spec.enums]
    blocks += [_flag_set(flags) for flags in spec.flag_sets]
    blocks += [_struct_class(struct) for struct in spec.structs]
    blocks += [_MESSAGE_BASES]
    blocks += [_message_class(message, spec) for message in spec.messages]
    blocks += [_tables(spec)]
    return "\n\n".join(block.strip("\n") + "\n" for block in blocks)


def class_name(name: str) -> str:
    """`set_target` becomes `SetTarget`."""
    return "".join(part.capitalize() for part in name.split("_"))


def _constants(spec: Spec) -> str:
    framing, eeprom = spec.framing, spec.eeprom
    numbers = {
        "BAUD": framing.baud,
        "BAUD_FALLBACK": framing.baud_fallback,
        "FRAME_DELIMITER": framing.delimiter,
        "MAX_PAYLOAD": framing.max_payload,
        "MAX_DECODED_FRAME": framing.max_decoded,
        "MAX_ENCODED_FRAME": framing.max_encoded,
    }
    slot = {
        "EEPROM_SIZE": eeprom.size,
        "EEPROM_SLOT_A": eeprom.slot_a,
        "EEPROM_SLOT_B": eeprom.slot_b,
        "EEPROM_SLOT_SIZE": eeprom.slot_size,
        "EEPROM_BOOT_COUNTER": eeprom.boot_counter,
        "EEPROM_BOOT_COUNTERS": eeprom.boot_counters,
    }
    lines = [
        f"PROTOCOL_VERSION: Final = {spec.version}",
        f"SPEC_HASH: Final = 0x{spec.hash:08X}",
        f"FIRMWARE_VERSION: Final = {spec.firmware_version}",
        "",
        *(f"{name}: Final = {value}" for name, value in numbers.items()),
        '"""Without the delimiter."""',
        "",
    ]
    for constant in spec.constants:
        lines.append(f"{constant.name.upper()}: Final = {constant.value}")
        lines.extend(_docstring(f"{constant.prose} [{constant.unit}]", ""))
    lines += ["", *(f"{name}: Final = {value}" for name, value in slot.items())]
    lines += [
        f"EEPROM_MAGIC: Final = 0x{eeprom.magic:04X}",
        f"EEPROM_LAYOUT: Final = {eeprom.layout}",
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


def _struct_format(fields: Iterable[Field]) -> str:
    return "".join(
        f"{field.count if field.count > 1 else ''}{_STRUCT_CODE[field.type.name]}"
        for field in fields
    )


def _struct_class(struct: Struct) -> str:
    lines = [
        *_class_head(struct, "Payload"),
        *_field_table(struct.fields),
        "",
        *_unpack(struct),
    ]
    if struct.consistency:
        lines += ["", *_inconsistent_axis(struct)]
    return "\n".join(lines)


def _message_class(message: Message, spec: Spec) -> str:
    lines = [
        *_class_head(message, "Request" if message.rules else "Message"),
        f"    ID: ClassVar[int] = 0x{message.id:02X}",
    ]
    if message.rules:
        rules = message.rules
        lines += [
            f"    REPLY_ID: ClassVar[int] = 0x{spec.message_by_name[rules.reply].id:02X}",
            f'    RETRY: ClassVar[Retry] = "{rules.retry}"',
            f"    NEEDS_SESSION: ClassVar[bool] = {rules.session}",
            *_allowed_states(rules.states, spec),
        ]
    lines += _field_table(message.fields)
    if message.struct:
        lines.append(f'    NESTED: ClassVar[str | None] = "{message.struct.attribute}"')
    return "\n".join([*lines, "", *_unpack(message)])


def _class_head(owner: Struct | Message, base: str) -> Iterator[str]:
    yield "@dataclass(frozen=True, slots=True)"
    yield f"class {class_name(owner.name)}({base}):"
    yield from _class_docstring(owner.name, owner.prose)
    yield ""
    for field in owner.fields:
        yield f"    {field.name}: {_annotation(field)}"
        yield from _docstring(field.description, "    ")
    nested = owner.struct if isinstance(owner, Message) else None
    if nested:
        yield f"    {nested.attribute}: {class_name(nested.name)}"
    if owner.fields or nested:
        yield ""
    yield f'    NAME: ClassVar[str] = "{owner.name}"'
    yield f"    SIZE: ClassVar[int] = {owner.size}"
    layout = _struct_format(owner.fields)
    yield f'    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<{layout}")'


def _annotation(field: Field) -> str:
    element = class_name(field.enum or field.flags or "") or "int"
    if field.count == 1:
        return element
    if field.count > _LONGEST_SPELT_OUT:
        return f"tuple[{element}, ...]"
    return f"tuple[{', '.join([element] * field.count)}]"


def _field_table(fields: Sequence[Field]) -> Iterator[str]:
    if not fields:
        yield "    FIELDS: ClassVar[tuple[Field, ...]] = ()"
        return
    calls = [_field_call(field) for field in fields]
    one_line = f"    FIELDS: ClassVar[tuple[Field, ...]] = (Field({', '.join(calls[0])}),)"
    if len(calls) == 1 and len(one_line) <= _WIDTH:
        yield one_line
        return
    yield "    FIELDS: ClassVar[tuple[Field, ...]] = ("
    for arguments in calls:
        yield from _call("Field", arguments, " " * 8)
    yield "    )"


def _field_call(field: Field) -> list[str]:
    arguments = [
        f'"{field.name}"',
        f'"{_STRUCT_CODE[field.type.name]}"',
        str(field.lower),
        str(field.upper),
    ]
    if field.count > 1:
        arguments.append(f"count={field.count}")
    if field.unit:
        arguments.append(f'unit="{field.unit}"')
    if field.scale != 1:
        arguments.append(f"scale={field.scale}")
    return arguments


def _call(function: str, arguments: Sequence[str], indent: str) -> Iterator[str]:
    line = f"{indent}{function}({', '.join(arguments)}),"
    if len(line) <= _WIDTH:
        yield line
        return
    yield f"{indent}{function}("
    for argument in arguments:
        yield f"{indent}    {argument},"
    yield f"{indent}),"


def _allowed_states(states: Sequence[str], spec: Spec) -> Iterator[str]:
    if set(states) == set(spec.enumerator_names("state")):
        yield "    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)"
        return
    names = [f"State.{state.upper()}" for state in states]
    if len(names) == 1:
        yield f"    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset({{{names[0]}}})"
        return
    yield "    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset("
    yield "        {"
    yield from (f"            {name}," for name in names)
    yield "        }"
    yield "    )"


def _unpack(owner: Struct | Message) -> Iterator[str]:
    nested = owner.struct if isinstance(owner, Message) else None
    yield "    @classmethod"
    yield "    def unpack(cls, payload: bytes) -> Self:"
    arguments = list(_constructor_arguments(owner.fields))
    if nested:
        offset = sum(field.size for field in owner.fields)
        tail = f"payload[{offset}:]" if offset else "payload"
        arguments.append(f"{class_name(nested.name)}.unpack({tail})")
    yield f"        {'values = ' if owner.fields else ''}cls._numbers(payload)"
    if len(arguments) <= 1:
        yield f"        return cls({', '.join(arguments)})"
        return
    yield "        return cls("
    for argument in arguments:
        yield f"            {argument},"
    yield "        )"


def _constructor_arguments(fields: Iterable[Field]) -> Iterator[str]:
    index = 0
    for field in fields:
        if field.count > _LONGEST_SPELT_OUT:
            yield f"values[{index}:{index + field.count}]"
        elif field.count > 1:
            yield f"({', '.join(f'values[{index + i}]' for i in range(field.count))})"
        elif field.enum:
            yield f'cls._enumerator("{field.name}", {class_name(field.enum)}, values[{index}])'
        elif field.flags:
            yield f"{class_name(field.flags)}(values[{index}])"
        else:
            yield f"values[{index}]"
        index += field.count


def _inconsistent_axis(struct: Struct) -> Iterator[str]:
    count = struct.fields[0].count
    yield "    def inconsistent_axis(self) -> int | None:"
    yield f"        for axis in range({count}):"
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
    lines = ["MESSAGES: Final[Mapping[int, type[Message]]] = MappingProxyType("]
    lines += ["    {", *(_by_id(message) for message in spec.messages), "    }", ")"]
    lines += ['"""By id."""', ""]
    lines += ["REQUESTS: Final[Mapping[int, type[Request]]] = MappingProxyType("]
    lines += ["    {", *(_by_id(message) for message in spec.requests), "    }", ")"]
    lines += ['"""By id."""', ""]
    lines += ["TRANSITIONS: Final[Mapping[tuple[State, Event], State]] = MappingProxyType("]
    lines += ["    {"]
    lines += [
        f"        (State.{t.source.upper()}, Event.{t.event.upper()}): State.{t.target.upper()},"
        for t in spec.transitions
    ]
    lines += ["    }", ")", '"""What is not listed changes nothing."""', ""]
    lines += ["REQUIREMENTS: Final[Mapping[str, str]] = MappingProxyType(", "    {"]
    for requirement in spec.requirements:
        lines += _requirement(requirement.id, requirement.text)
    lines += ["    }", ")", '"""Text by id; the conformance suite names the ids."""']
    return "\n".join(lines)


def _by_id(message: Message) -> str:
    return f"        0x{message.id:02X}: {class_name(message.name)},"


def _requirement(name: str, text: str) -> Iterator[str]:
    line = f'        "{name}": "{text}",'
    if len(line) <= _WIDTH:
        yield line
        return
    yield f'        "{name}": ('
    for chunk in _chunks(text, _WIDTH - 14):
        yield f'            "{chunk}"'
    yield "        ),"


def _chunks(text: str, width: int) -> list[str]:
    if len(text) <= width:
        return [text]
    lines = textwrap.wrap(text, width - 1)
    return [line + " " for line in lines[:-1]] + lines[-1:]


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
    if len(f'{indent}"""{text}"""') <= _WIDTH:
        return [f'{indent}"""{text}"""']
    first, *more = textwrap.wrap(text, _WIDTH - len(indent) - 3)
    return [f'{indent}"""{first}', *(indent + line for line in more), f'{indent}"""']
