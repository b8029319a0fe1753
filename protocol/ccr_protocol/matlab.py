"""Makes the tables of the MATLAB and Octave client: matlab/+ccr/spec.m."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ccr_protocol.spec import Field, Message, Spec

_TYPES = {"u8": "uint8", "i8": "int8", "u16": "uint16", "i16": "int16", "u32": "uint32"}
_TYPES |= {"i32": "int32"}

_HEAD = """\
function s = spec()
%SPEC Messages of the wire protocol. Generated from protocol/spec.toml: do not edit.
%   s.messages.NAME has the fields id, reply (id, or 0), session, retry, optional (the
%   capability of boards that know it, '' if all do) and fields: one row a field with name, type,
%   count (0: the board's axes), least, greatest, scale and the name of its enumeration.
%   s.names{id} is the name of a message; s.enums.NAME has one field a value.
persistent made
if isempty(made)
  made = make();
end
s = made;
end

function s = make()
"""


def generate(spec: Spec) -> str:
    """Text of `matlab/+ccr/spec.m`."""
    return _HEAD + "\n".join([*_lines(spec), "end"]) + "\n"


def _lines(spec: Spec) -> Iterator[str]:
    yield f"s.protocol_version = {spec.version};"
    yield f"s.spec_hash = {spec.hash};"
    yield f"s.baud = {spec.framing.baud};"
    framing, protocol = spec.framing, spec.protocol
    yield f"s.small_axes = {protocol.small_axes};"
    yield f"s.max_axes = {protocol.max_axes};"
    yield f"s.max_payload_small = {framing.max_payload};"
    yield f"s.max_payload_large = {framing.max_payload_large or framing.max_payload};"
    for enum in spec.enums:
        yield f"s.enums.{enum.name} = {_values(enum.numbers)};"
    for flags in spec.flag_sets:
        bits = {name: 1 << bit for name, bit in flags.numbers.items()}
        yield f"s.flags.{flags.name} = {_values(bits)};"
    yield "s.names = cell(1, 255);"
    for message in spec.messages:
        yield from _message(message, spec)


def _values(numbers: Mapping[str, int]) -> str:
    pairs = ", ".join(f"'{name}', {number}" for name, number in numbers.items())
    return f"struct({pairs})"


def _message(message: Message, spec: Spec) -> Iterator[str]:
    rules = message.rules
    reply = spec.message_by_name[rules.reply].id if rules else 0
    session = "true" if rules and rules.session else "false"
    yield f"s.names{{{message.id}}} = '{message.name}';"
    yield (
        f"s.messages.{message.name} = struct('id', {message.id}, 'reply', {reply}, "
        f"'session', {session}, 'retry', '{rules.retry if rules else ''}', "
        f"'optional', '{message.optional or ''}', 'fields',{{{{ ..."
    )
    for field in message.wire_fields:
        yield f"  {_row(field)}; ..."
    yield "  }});"


def _row(field: Field) -> str:
    type_ = _TYPES[field.type.name]
    count = 0 if field.is_per_axis else field.count
    numbers = f"{count}, {field.lower}, {field.upper}, {field.scale:g}"
    return f"'{field.name}', '{type_}', {numbers}, '{field.enum or ''}'"
