"""Makes the C++14 header: no heap, no standard library beyond <stdint.h>, made for avr-gcc 5.4."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from itertools import chain

from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import (
    FRAME_OVERHEAD,
    REFERENCE_AXES,
    SLOT_FRAMING,
    Constant,
    Enumeration,
    Field,
    FlagSet,
    Message,
    Size,
    Spec,
    Struct,
)
from ccr_protocol.values import INTEGER_TYPES, IntegerType

_WIDTH = 100
_LAYOUT_MESSAGE = '"payload layout");'
_INT_SIZE_ON_AVR = 2
_LONGEST_UNROLLED = 4
"""Longer arrays are gone through in a loop, which takes less flash."""

_HEAD = """\
// Messages of the wire protocol. Generated from protocol/spec.toml: do not edit.
#ifndef CCR_MESSAGES_H
#define CCR_MESSAGES_H

#include <stdint.h>

#include "little_endian.h"

// Axes of the board: a flag of the build, as it decides on the length of messages.
#ifndef CCR_AXES
#define CCR_AXES %d
#endif

namespace ccr {
"""

_READING = """\
/// What became of a payload.
enum class Reading : uint8_t {
  kOk,
  kBadLength,
  kUndefinedValue,  ///< An enumeration does not have the value.
};

/// Answer of `first_out_of_range` and `inconsistent_axis` where there is nothing to report.
constexpr int8_t kNone = -1;
"""

_RULES = """\
enum class Retry : uint8_t {
  kRepeat,  ///< Executed again.
  kOnce,    ///< Repeated with the same sequence number it is answered from memory.
  kNever,   ///< Not repeated; the next one replaces it.
};

constexpr uint16_t state_bit(State state) {
  return static_cast<uint16_t>(1U << static_cast<uint8_t>(state));
}

/// How the board treats a request.
struct RequestRule {
  uint8_t id;
  uint8_t reply_id;
  uint8_t size;
  Retry retry;
  bool needs_session;
  uint16_t allowed_states;  ///< Bits of `state_bit`.
};
"""

_RULE_FUNCTIONS = """\
/// The rule of a request, or null where no request has this id.
constexpr const RequestRule* find_request(uint8_t id) {
  for (const RequestRule& rule : kRequestRules) {
    if (rule.id == id) {
      return &rule;
    }
  }
  return nullptr;
}

constexpr bool is_allowed(const RequestRule& rule, State state) {
  return (rule.allowed_states & state_bit(state)) != 0;
}
"""

_TRANSITION = """\
struct Transition {
  uint16_t from;  ///< Bits of `state_bit`.
  Event event;
  State to;
};
"""

_NEXT_STATE = """\
/// The state after an event; what is not listed changes nothing.
constexpr State next_state(State state, Event event) {
  for (const Transition& transition : kTransitions) {
    if (transition.event == event && (transition.from & state_bit(state)) != 0) {
      return transition.to;
    }
  }
  return state;
}
"""

_FOOT = """\
}  // namespace ccr

#endif
"""


def generate(spec: Spec) -> str:
    """Text of `ccr_messages.h`."""
    blocks = [_HEAD % REFERENCE_AXES, _constants(spec)]
    blocks += [_enumeration(enum) for enum in spec.enums]
    blocks += [_flag_set(flags) for flags in spec.flag_sets]
    blocks += [_READING]
    blocks += [_struct(struct) for struct in spec.structs]
    blocks += [_message(message) for message in spec.messages]
    blocks += [_RULES, _request_rules(spec), _RULE_FUNCTIONS]
    blocks += [_TRANSITION, _transitions(spec), _NEXT_STATE, _FOOT]
    return "\n".join(block.strip("\n") + "\n" for block in blocks)


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _cpp_type(integer: IntegerType) -> str:
    return f"{'int' if integer.signed else 'uint'}{8 * integer.size}_t"


def _literal(value: int, integer: IntegerType) -> str:
    suffix = "" if integer.signed else "U"
    return f"{value}{suffix}{'L' if integer.size > _INT_SIZE_ON_AVR else ''}"


def _comment(text: str, indent: str = "") -> list[str]:
    mark = f"{indent}/// "
    return textwrap.wrap(text, _WIDTH, initial_indent=mark, subsequent_indent=mark)


def _constants(spec: Spec) -> str:
    framing, eeprom = spec.framing, spec.eeprom
    major, minor, patch = spec.firmware_version
    saved = Size.of(spec.saved_fields)
    lines = [
        f"constexpr uint8_t kProtocolVersion = {spec.version};",
        f"constexpr uint32_t kSpecHash = 0x{spec.hash:08X}UL;",
        f"constexpr uint8_t kFirmwareVersion[3] = {{{major}, {minor}, {patch}}};",
        "",
        "constexpr uint8_t kAxes = CCR_AXES;",
        f"constexpr uint8_t kMaxAxes = {spec.protocol.max_axes};",
        'static_assert(CCR_AXES >= 1 && CCR_AXES <= kMaxAxes, "as the spec says");',
        f"constexpr bool kIsLarge = kAxes > {spec.protocol.small_axes};",
        "",
        f"constexpr uint32_t kBaud = {framing.baud}UL;",
        f"constexpr uint32_t kBaudFallback = {framing.baud_fallback}UL;",
        f"constexpr uint8_t kFrameDelimiter = {framing.delimiter};",
        f"constexpr uint8_t kMaxPayload = "
        f"{_figure(framing.max_payload, framing.max_payload_large)};",
        f"constexpr uint8_t kMaxDecodedFrame = kMaxPayload + {FRAME_OVERHEAD};",
        "constexpr uint8_t kMaxEncodedFrame = kMaxDecodedFrame + 1;  ///< Without the delimiter.",
        "",
        *chain.from_iterable(_constant(constant) for constant in spec.constants),
        "",
        f"constexpr uint16_t kEepromSize = {eeprom.size};",
        f"constexpr uint16_t kEepromSlotA = {eeprom.slot_a};",
        f"constexpr uint16_t kEepromSlotB = {_figure(eeprom.slot_b, eeprom.slot_b_large)};",
        f"constexpr uint16_t kEepromSlotSize = {_sum(saved.fixed + SLOT_FRAMING, saved.per_axis)};",
        f"constexpr uint16_t kEepromBootCounter = {eeprom.boot_counter};",
        f"constexpr uint8_t kEepromBootCounters = {eeprom.boot_counters};",
        f"constexpr uint16_t kEepromMagic = 0x{eeprom.magic:04X}U;",
        f"constexpr uint8_t kEepromLayout = {eeprom.layout};",
    ]
    return "\n".join(lines)


def _figure(small: object, large: object = None) -> str:
    return str(small) if large is None else f"kIsLarge ? {large} : {small}"


def _sum(fixed: int, per_axis: int) -> str:
    """Bytes, of which some are there for each axis."""
    each = f"{per_axis} * kAxes" if per_axis > 1 else "kAxes"
    if not per_axis:
        return str(fixed)
    return f"{fixed} + {each}" if fixed else each


def _bytes(fields: Iterable[Field]) -> str:
    return _sum(*Size.of(fields))


def _count(field: Field) -> str:
    return "kAxes" if field.is_per_axis else str(field.count)


def _constant(constant: Constant) -> list[str]:
    values = [constant.value] if constant.large is None else [constant.value, constant.large]
    integer = next(t for t in INTEGER_TYPES.values() if all(map(t.holds, values)))
    small, *large = (_literal(value, integer) for value in values)
    value = _figure(small, *large)
    return [
        *_comment(f"{constant.prose} [{constant.unit}]"),
        f"constexpr {_cpp_type(integer)} k{_camel(constant.name)} = {value};",
    ]


def _enumeration(enum: Enumeration) -> str:
    lines = [*_comment(enum.prose), f"enum class {_camel(enum.name)} : {_cpp_type(enum.type)} {{"]
    for value in enum.values:
        lines += _comment(value.prose, "  ")
        lines.append(f"  k{_camel(value.name)} = {value.value},")
    lines.append("};")
    if not enum.internal:
        parameter = f"{_cpp_type(enum.type)} value"
        lines += ["", f"constexpr bool is_{enum.name}({parameter}) {{"]
        lines += [*_defined_values(enum), "}"]
    return "\n".join(lines)


def _defined_values(enum: Enumeration) -> list[str]:
    numbers = sorted(value.value for value in enum.values)
    first, last = (_literal(number, enum.type) for number in (numbers[0], numbers[-1]))
    if numbers != list(range(numbers[0], numbers[-1] + 1)):
        alternatives = " || ".join(f"value == {_literal(n, enum.type)}" for n in numbers)
        return textwrap.wrap(
            f"return {alternatives};", _WIDTH, initial_indent="  ", subsequent_indent="      "
        )
    return [f"  return {f'value >= {first} && ' if numbers[0] else ''}value <= {last};"]


def _flag_set(flags: FlagSet) -> str:
    lines = [*_comment(flags.prose), f"namespace {flags.name} {{"]
    for bit in flags.bits:
        lines += _comment(bit.prose)
        lines.append(
            f"constexpr {_cpp_type(flags.type)} k{_camel(bit.name)} = 0x{1 << bit.bit:02X};"
        )
    return "\n".join([*lines, f"}}  // namespace {flags.name}"])


def _struct(struct: Struct) -> str:
    name = _camel(struct.name)
    lines = [
        *_comment(struct.prose),
        f"struct {name} {{",
        f"  enum : uint8_t {{ kSize = {_bytes(struct.fields)} }};",
        "",
        *_members(struct.fields),
        "};",
        *_size_assertion(name, struct.fields, None),
        "",
        f"inline void encode(const {name}& value, uint8_t* bytes) {{",
        *_put_whole(name, "bytes"),
        *_puts(struct.fields),
        "}",
        "",
        f"inline Reading decode(const uint8_t* bytes, {name}& value) {{",
        *_get_whole(name, struct.fields, "bytes"),
        *_gets(struct.fields),
        "  return Reading::kOk;",
        "}",
        "",
        *_first_out_of_range(name, struct.fields, None),
        "",
        *_inconsistent_axis(name, struct.consistency, struct.fields),
    ]
    return "\n".join(lines)


def _message(message: Message) -> str:
    name = _camel(message.name)
    empty = not message.size
    value, payload = ("", "") if empty else ("value", "payload")
    lines = [
        *_comment(message.prose),
        f"struct {name} {{",
        f"  enum : uint8_t {{ kId = 0x{message.id:02X}, kSize = {_bytes(message.wire_fields)} }};",
        *([] if empty else [""]),
        *_members(message.fields),
    ]
    if message.struct:
        lines.append(f"  {_camel(message.struct.name)} {message.struct.attribute};")
    lines += [
        "};",
        *_size_assertion(name, message.fields, message.struct),
        "",
        f"inline void encode({f'const {name}& {value}'.strip()}, "
        f"{f'uint8_t* {payload}'.strip()}) {{{'}' if empty else ''}",
        *([] if empty else _put_whole(name, "payload")),
        *_puts(message.fields, "payload"),
    ]
    tail = _at("payload", _bytes(message.fields))
    if message.struct:
        lines.append(f"  encode(value.{message.struct.attribute}, {tail});")
    lines += [
        *([] if empty else ["}"]),
        "",
        f"inline Reading decode({f'const uint8_t* {payload}'.strip()}, uint8_t size, "
        f"{f'{name}& {value}'.strip()}) {{",
        f"  if (size != {name}::kSize) {{",
        "    return Reading::kBadLength;",
        "  }",
        *([] if empty else _get_whole(name, message.wire_fields, "payload")),
        *_gets(message.fields, "payload"),
        f"  return decode({tail}, value.{message.struct.attribute});"
        if message.struct
        else "  return Reading::kOk;",
        "}",
        "",
        *_first_out_of_range(name, message.fields, message.struct),
        "",
        *_message_inconsistent_axis(name, message.struct),
    ]
    return "\n".join(lines)


def _members(fields: Iterable[Field]) -> Iterator[str]:
    for field in fields:
        bits = f" Bits of `{field.flags}`." if field.flags else ""
        yield from _comment(field.description + bits, "  ")
        cpp_type = _camel(field.enum) if field.enum else _cpp_type(field.type)
        array = f"[{_count(field)}]" if field.is_array else ""
        yield f"  {cpp_type} {field.name}{array};"


def _size_assertion(name: str, fields: Iterable[Field], struct: Struct | None) -> list[str]:
    parts = [f"sizeof({name}::{field.name})" for field in fields] or ["0"]
    if struct:
        parts.append(f"{_camel(struct.name)}::kSize")
    total = " + ".join(parts)
    condition = f"{name}::kSize == {total} && uint8_t{{{name}::kSize}} <= kMaxPayload"
    lines = textwrap.wrap(f"static_assert({condition},", _WIDTH, subsequent_indent="              ")
    if len(lines[-1]) + len(_LAYOUT_MESSAGE) < _WIDTH:
        lines[-1] += f" {_LAYOUT_MESSAGE}"
    else:
        lines.append(f"              {_LAYOUT_MESSAGE}")
    return lines


def _elements(fields: Iterable[Field], bytes_name: str) -> Iterator[tuple[Field, str, str]]:
    """Field, address and C++ expression of each element; one, with `at`, for a looped array."""
    offset = Size(0, 0)
    for field in fields:
        if _is_looped(field):
            step = "at" if field.type.size == 1 else f"{field.type.size} * at"
            yield field, f"{_at(bytes_name, _sum(*offset))} + {step}", f"value.{field.name}[at]"
        else:
            for index in range(field.count):
                element = f"[{index}]" if field.is_array else ""
                start = _sum(offset.fixed + index * field.type.size, offset.per_axis)
                yield field, _at(bytes_name, start), f"value.{field.name}{element}"
        size = Size.of([field])
        offset = Size(offset.fixed + size.fixed, offset.per_axis + size.per_axis)


def _is_looped(field: Field) -> bool:
    return field.is_per_axis or field.count > _LONGEST_UNROLLED


def _for_each(field: Field, statement: str) -> Iterator[str]:
    if _is_looped(field):
        yield f"  for (uint8_t at = 0; at < {_count(field)}; ++at) {{"
        yield f"    {statement}"
        yield "  }"
    else:
        yield f"  {statement}"


def _put_whole(name: str, bytes_name: str) -> list[str]:
    return [
        f"  if (lies_as_on_the_wire<{name}>()) {{",
        f"    __builtin_memcpy({bytes_name}, &value, {name}::kSize);",
        "    return;",
        "  }",
    ]


def _get_whole(name: str, fields: Iterable[Field], bytes_name: str) -> list[str]:
    """Nothing where an enumeration has to be looked at."""
    if any(field.enum for field in fields):
        return []
    return [
        f"  if (lies_as_on_the_wire<{name}>()) {{",
        f"    __builtin_memcpy(&value, {bytes_name}, {name}::kSize);",
        "    return Reading::kOk;",
        "  }",
    ]


def _puts(fields: Iterable[Field], bytes_name: str = "bytes") -> Iterator[str]:
    for field, place, element in _elements(fields, bytes_name):
        number = f"static_cast<{_cpp_type(field.type)}>({element})" if field.enum else element
        yield from _for_each(field, f"put_{field.type.name}({place}, {number});")


def _gets(fields: Iterable[Field], bytes_name: str = "bytes") -> Iterator[str]:
    for field, place, element in _elements(fields, bytes_name):
        number = f"get_{field.type.name}({place})"
        if field.enum:
            yield f"  if (!is_{field.enum}({number})) {{"
            yield "    return Reading::kUndefinedValue;"
            yield "  }"
            number = f"static_cast<{_camel(field.enum)}>({number})"
        yield from _for_each(field, f"{element} = {number};")


def _at(bytes_name: str, offset: str) -> str:
    return bytes_name if offset == "0" else f"{bytes_name} + {offset}"


def _first_out_of_range(name: str, fields: tuple[Field, ...], struct: Struct | None) -> list[str]:
    body: list[str] = []
    for index, field in enumerate(fields):
        looped = field.is_per_axis
        elements = ["[at]"] if looped else [f"[{at}]" for at in range(field.count)]
        tests = [
            f"value.{field.name}{element if field.is_array else ''} {test}"
            for element in elements
            for test in _range_tests(field)
        ]
        if tests:
            indent = "    " if looped else "  "
            body += [f"  for (uint8_t at = 0; at < {_count(field)}; ++at) {{"] if looped else []
            body += textwrap.wrap(
                f"if ({' || '.join(tests)}) {{",
                _WIDTH,
                initial_indent=indent,
                subsequent_indent=indent + "    ",
            )
            body += [f"{indent}  return {index};", f"{indent}}}", *(["  }"] if looped else [])]
    if struct and _has_ranges(struct):
        attribute = f"value.{struct.attribute}"
        if fields:
            body += [
                f"  const int8_t nested = first_out_of_range({attribute});",
                f"  return nested == kNone ? kNone : static_cast<int8_t>(nested + {len(fields)});",
            ]
        else:
            body.append(f"  return first_out_of_range({attribute});")
    else:
        body.append("  return kNone;")
    value = " value" if len(body) > 1 or "value" in body[0] else ""
    return [
        "/// Index of the first field out of its range; an array is one field.",
        f"inline int8_t first_out_of_range(const {name}&{value}) {{",
        *body,
        "}",
    ]


def _range_tests(field: Field) -> list[str]:
    tests = []
    if field.lower > field.type.minimum:
        tests.append(f"< {_literal(field.lower, field.type)}")
    if field.upper < field.type.maximum:
        tests.append(f"> {_literal(field.upper, field.type)}")
    return tests


def _has_ranges(struct: Struct) -> bool:
    return any(_range_tests(field) for field in struct.fields)


def _inconsistent_axis(
    name: str, clauses: tuple[Clause, ...], fields: tuple[Field, ...]
) -> list[str]:
    if not clauses:
        return [f"inline int8_t inconsistent_axis(const {name}&) {{", "  return kNone;", "}"]
    axes = next(_count(field) for field in fields if field.name in clauses[0].fields)
    conditions = [_clause(clause) for clause in clauses]
    return [
        "/// First axis whose fields, each in range, contradict each other.",
        f"inline int8_t inconsistent_axis(const {name}& value) {{",
        f"  for (int8_t axis = 0; axis < {axes}; ++axis) {{",
        "    const bool consistent =",
        *(f"        {condition} &&" for condition in conditions[:-1]),
        f"        {conditions[-1]};",
        "    if (!consistent) {",
        "      return axis;",
        "    }",
        "  }",
        "  return kNone;",
        "}",
    ]


def _clause(clause: Clause) -> str:
    if isinstance(clause, Comparison):
        return f"value.{clause.left}[axis] {clause.operator} value.{clause.right}[axis]"
    element = f"value.{clause.field}[axis]"
    return f"({element} < {clause.first} || {element} > {clause.last})"


def _message_inconsistent_axis(name: str, struct: Struct | None) -> list[str]:
    if struct and struct.consistency:
        return [
            f"inline int8_t inconsistent_axis(const {name}& value) {{",
            f"  return inconsistent_axis(value.{struct.attribute});",
            "}",
        ]
    return [f"inline int8_t inconsistent_axis(const {name}&) {{", "  return kNone;", "}"]


def _request_rules(spec: Spec) -> str:
    rows = []
    for message in spec.requests:
        assert message.rules is not None
        name, reply = _camel(message.name), _camel(message.rules.reply)
        retry = f"Retry::k{message.rules.retry.capitalize()}"
        session = "true" if message.rules.session else "false"
        rows.append(
            f"    {{{name}::kId, {reply}::kId, {name}::kSize, {retry}, {session}, "
            f"0x{_state_bits(message.rules.states, spec):04X}U}},"
        )
    return "\n".join(["constexpr RequestRule kRequestRules[] = {", *rows, "};"])


def _state_bits(states: Iterable[str], spec: Spec) -> int:
    numbers = {value.name: value.value for value in spec.enum_by_name["state"].values}
    return sum(1 << numbers[state] for state in states)


def _transitions(spec: Spec) -> str:
    sources: dict[tuple[str, str], list[str]] = {}
    for transition in spec.transitions:
        sources.setdefault((transition.event, transition.target), []).append(transition.source)
    rows = [
        f"    {{0x{_state_bits(states, spec):04X}U, Event::k{_camel(event)}, "
        f"State::k{_camel(to)}}},"
        for (event, to), states in sources.items()
    ]
    return "\n".join(["constexpr Transition kTransitions[] = {", *rows, "};"])
