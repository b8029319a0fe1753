"""The streams of the golden vectors, each with what it was made to provoke."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from ccr_protocol.codec import (
    Frame,
    Value,
    cobs_encode,
    crc16_x25,
    elements,
    encode_frame,
    frame_content,
    pack,
)
from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import FRAME_OVERHEAD, Field, Message, Spec

_SAMPLE = "set_target"
"""Message whose frame is damaged in every way: it has zeros, and moves the robot."""

_AFTER = Frame(0x12, 8, b"")
"""Follows damaged ones. It is short, so that nothing before it could be completed by it."""

_FREE_ID = 0x7E
"""Not a message: framing alone is tried."""

CONSISTENT_VALUES: Mapping[str, tuple[int, int]] = {
    "angle_min_cdeg": (-8500, -8000),
    "angle_max_cdeg": (8500, 8000),
    "rest_cdeg": (100, -250),
    "neutral_half_us": (3000, 2960),
    "per_90_deg_half_us": (2000, -1980),
    "pulse_min_half_us": (1000, 1100),
    "pulse_max_half_us": (5000, 4900),
}
"""Values of fields that consistency rules mention, of axes in turns: a plausible robot."""


@dataclass(frozen=True)
class Case:
    """A stream, and what a receiver must make of it.

    `frames` are those that it must accept, no others; `errors` what it must count, or None where
    that follows from the damage and is only computed.
    """

    name: str
    stream: bytes
    frames: tuple[Frame, ...]
    errors: tuple[str, ...] | None = ()


def all_cases(spec: Spec) -> Iterator[Case]:
    """Every case, always in the same order."""
    yield from _messages(spec, spec.messages)
    yield from _fields_out_of_range(spec, spec.messages)
    yield from _contradictions(spec)
    yield from _undefined_enumerators(spec)
    yield from _lengths(spec, spec.requests)
    yield from _ids(spec)
    yield from _sequence_numbers(spec)
    yield from _delimiters(spec)
    yield from _sizes(spec)
    yield from _payload_patterns(spec)
    yield from _crc_bytes()
    yield from _encodings(spec)
    yield from _damage(spec)


def cases_of_axes(spec: Spec, axes: int) -> Iterator[Case]:
    """What depends on the number of axes: lengths, elements and the longest frame."""
    own = [message for message in spec.messages if any(f.is_per_axis for f in message.wire_fields)]
    cases = (
        *_messages(spec, own),
        *_lengths(spec, [message for message in own if message.rules]),
        *_on_the_ends(spec, own),
        *_sizes(spec),
        *_payload_patterns(spec),
    )
    for case in cases:
        yield replace(case, name=f"{axes} axes, {case.name}")


def _on_the_ends(spec: Spec, messages: Sequence[Message]) -> Iterator[Case]:
    """Cases of single elements, of the first and the last axis."""
    ends = "[0]", f"[{spec.axes - 1}]"
    for case in (*_fields_out_of_range(spec, messages), *_contradictions(spec)):
        if any(end in case.name for end in ends):
            yield case


def _good(name: str, *frames: Frame) -> Case:
    return Case(name, b"".join(encode_frame(frame) for frame in frames), frames)


def _bad(name: str, stream: bytes, error: str) -> Case:
    """Make a case of a bad frame, and a whole one after it that must be understood."""
    return Case(f"{name}, then a frame", stream + encode_frame(_AFTER), (_AFTER,), (error,))


def _damaged(name: str, stream: bytes) -> Case:
    return Case(f"{name}, then a frame", stream + encode_frame(_AFTER), (_AFTER,), None)


def typical_values(spec: Spec, fields: Sequence[Field]) -> dict[str, Value]:
    """Values in range, all different where the range lets them, that do not contradict."""
    return {
        field.name: _consistent(field) or _value_inside(spec, field, index)
        for index, field in enumerate(fields)
    }


def _consistent(field: Field) -> Value | None:
    pair = CONSISTENT_VALUES.get(field.name)
    return pair and [pair[axis % 2] - axis // 2 for axis in range(field.count)]


def _value_inside(spec: Spec, field: Field, index: int) -> Value:
    if field.enum:
        return spec.enum_by_name[field.enum].values[-1].value
    span = field.upper - field.lower
    numbers = [field.lower + span * (3 + index + axis) // 23 for axis in range(field.count)]
    return numbers if field.is_array else numbers[0]


def _extreme_values(spec: Spec, fields: Sequence[Field], *, greatest: bool) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for field in fields:
        if field.enum:
            numbers = [value.value for value in spec.enum_by_name[field.enum].values]
            extreme = max(numbers) if greatest else min(numbers)
        else:
            extreme = field.upper if greatest else field.lower
        values[field.name] = [extreme] * field.count if field.is_array else extreme
    return values


def _messages(spec: Spec, messages: Sequence[Message]) -> Iterator[Case]:
    """Least, greatest and typical values of every message."""
    for number, message in enumerate(messages):
        fields = message.wire_fields
        variants = {
            "least": _extreme_values(spec, fields, greatest=False),
            "greatest": _extreme_values(spec, fields, greatest=True),
            "typical": typical_values(spec, fields),
        }
        if not fields:
            variants = {"empty": {}}
        for variant, values in variants.items():
            frame = Frame(message.id, number, pack(fields, values))
            yield _good(f"{message.name}: {variant}", frame)


def _with_field(spec: Spec, message: Message, name: str, value: Value) -> Frame:
    values = {**typical_values(spec, message.wire_fields), name: value}
    return Frame(message.id, 1, pack(message.wire_fields, values))


def _fields_out_of_range(spec: Spec, messages: Sequence[Message]) -> Iterator[Case]:
    """One step below and above each range, in each element of an array."""
    for message in messages:
        for field in message.wire_fields:
            bad = {"below": field.lower - 1, "above": field.upper + 1}
            for (side, value), axis in product(bad.items(), range(field.count)):
                if field.type.holds(value):
                    inside = typical_values(spec, [field])[field.name]
                    frame = _with_field(spec, message, field.name, _replaced(inside, axis, value))
                    element = f"[{axis}]" if field.is_array else ""
                    yield _good(f"{message.name}: {field.name}{element} {side} its range", frame)


def _replaced(value: Value, index: int, number: int) -> Value:
    if isinstance(value, int):
        return number
    return [*value[:index], number, *value[index + 1 :]]


def _contradictions(spec: Spec) -> Iterator[Case]:
    """Each clause of each consistency rule around its edge, on each axis."""
    for message in spec.requests:
        if message.struct:
            values = typical_values(spec, message.struct.fields)
            for clause in message.struct.consistency:
                for name, axis, number in _around_edge(clause, values):
                    value = _replaced(values[name], axis, number)
                    frame = _with_field(spec, message, name, value)
                    yield _good(f"{message.name}: {name}[{axis}] = {number}", frame)


def _around_edge(clause: Clause, values: Mapping[str, Value]) -> Iterator[tuple[str, int, int]]:
    if isinstance(clause, Comparison):
        for axis, right in enumerate(elements(values[clause.right])):
            for step in (-1, 0, 1):
                yield clause.left, axis, right + step
    else:
        for axis in range(len(elements(values[clause.field]))):
            for number in (clause.first - 1, clause.first, clause.last, clause.last + 1):
                yield clause.field, axis, number


def _undefined_enumerators(spec: Spec) -> Iterator[Case]:
    """Try the value after the last one, and the greatest of the type."""
    for message in spec.messages:
        for field in message.wire_fields:
            if field.enum:
                last = max(value.value for value in spec.enum_by_name[field.enum].values)
                for value in (last + 1, field.type.maximum):
                    frame = _with_field(spec, message, field.name, value)
                    yield _good(f"{message.name}: {field.name} = {value}", frame)


def _sample(spec: Spec) -> Frame:
    message = spec.message_by_name[_SAMPLE]
    fields = message.wire_fields
    return Frame(message.id, 7, pack(fields, typical_values(spec, fields)))


def _lengths(spec: Spec, messages: Sequence[Message]) -> Iterator[Case]:
    """Every request one byte too short and, where the frame can be that long, one too long."""
    for message in messages:
        payload = pack(message.wire_fields, typical_values(spec, message.wire_fields))
        if payload:
            yield _good(f"{message.name}: one byte short", Frame(message.id, 2, payload[:-1]))
        if len(payload) < spec.framing.max_payload:
            yield _good(f"{message.name}: one byte more", Frame(message.id, 2, payload + b"\x01"))


def _ids(spec: Spec) -> Iterator[Case]:
    """Ids that no message has."""
    known = {message.id for message in spec.messages}
    unknown = [
        number for number in (0x00, 0x0F, 0x6F, 0x7F, 0x80, 0xBF, 0xFF) if number not in known
    ]
    for number in unknown:
        yield _good(f"id 0x{number:02X}", Frame(number, 3, b""))


def _sequence_numbers(spec: Spec) -> Iterator[Case]:
    sample = _sample(spec)
    for sequence in (0, 1, 127, 128, 255):
        yield _good(f"sequence number {sequence}", replace(sample, sequence=sequence))


def _delimiters(spec: Spec) -> Iterator[Case]:
    sample = _sample(spec)
    frame = encode_frame(sample)
    yield Case("nothing", b"", ())
    yield Case("one zero", b"\0", ())
    yield Case("many zeros", bytes(200), ())
    yield Case("zeros before a frame", bytes(3) + frame, (sample,))
    yield Case("zeros after a frame", frame + bytes(3), (sample,))
    yield Case("two frames abutting", frame + frame, (sample, sample))
    yield Case("two frames with zeros between", frame + bytes(5) + frame, (sample, sample))
    yield Case("a frame without its zero", frame[:-1], ())
    yield Case("two frames without the zero between", frame[:-1] + frame, (), None)
    yield Case("half a frame, then a whole one", frame[:7] + frame, (), None)
    yield _damaged("half a frame, a zero", frame[:7] + b"\0")
    yield _damaged("noise, a zero", b"\x55\xaa\xff\x13\0")


def _sizes(spec: Spec) -> Iterator[Case]:
    longest, limit = spec.framing.max_payload, spec.framing.max_encoded
    yield _good("shortest frame", Frame(_FREE_ID, 0, b""))
    yield _good("longest payload", Frame(_FREE_ID, 0, _counting(longest)))
    for size in range(FRAME_OVERHEAD):
        yield _bad(f"{size} bytes decoded", cobs_encode(_counting(size)) + b"\0", "bad_size")
        yield _bad(f"{size} zeros decoded", cobs_encode(bytes(size)) + b"\0", "bad_size")
    for size in (longest + 1, 2 * longest, 249):
        too_long = encode_frame(Frame(_FREE_ID, 0, _counting(size)))
        yield _bad(f"payload of {size} bytes", too_long, "bad_size")
    for size in (limit + 1, 254, 255, 256, 300, 1000):
        yield _bad(f"{size} bytes without a zero", _counting(size) + b"\0", "bad_size")
        yield _bad(f"{size} bytes 0xFF", b"\xff" * size + b"\0", "bad_size")
        yield _bad(f"{size} bytes 0x01", b"\x01" * size + b"\0", "bad_size")
    yield _bad(f"{limit} bytes 0xFF", b"\xff" * limit + b"\0", "bad_encoding")


def _counting(size: int) -> bytes:
    return bytes(index % 255 + 1 for index in range(size))


def _payload_patterns(spec: Spec) -> Iterator[Case]:
    size = spec.framing.max_payload
    patterns = {
        "zeros": bytes(size),
        "0xFF": b"\xff" * size,
        "0x01": b"\x01" * size,
        "zero and 0xFF in turns": b"\x00\xff" * (size // 2),
        "a run of 0xFF between zeros": bytes(8) + b"\xff" * (size - 16) + bytes(8),
        "one zero at the start": b"\x00" + b"\xa5" * (size - 1),
        "one zero at the end": b"\xa5" * (size - 1) + b"\x00",
    }
    for name, payload in patterns.items():
        yield _good(f"payload of {name}", Frame(_FREE_ID, 0x5A, payload))
    yield _good("id, sequence number and payload all zero", Frame(0, 0, bytes(size)))


def _crc_bytes() -> Iterator[Case]:
    """Make zeros of the CRC's own bytes, which COBS has to replace."""
    conditions: dict[str, Callable[[int], bool]] = {
        "first CRC byte zero": lambda crc: not crc & 0x00FF,
        "last CRC byte zero": lambda crc: not crc & 0xFF00,
        "both CRC bytes zero": lambda crc: not crc,
        "both CRC bytes 0xFF": lambda crc: not crc ^ 0xFFFF,
    }
    for name, condition in conditions.items():
        yield _good(name, next(frame for frame in _numbered_frames() if condition(_crc(frame))))


def _numbered_frames() -> Iterator[Frame]:
    for number in range(1 << 24):
        yield Frame(0x03, 9, number.to_bytes(4, "little"))


def _crc(frame: Frame) -> int:
    return int.from_bytes(frame_content(frame)[-2:], "little")


def _encodings(spec: Spec) -> Iterator[Case]:
    frame = encode_frame(_sample(spec))
    for name, chunk in {
        "code byte beyond the end": "05 11 22",
        "code byte with nothing after it": "02",
        "code byte 0xFF in a short frame": "ff 01 02 03",
        "second code byte beyond the end": "03 11 22 03 33",
        "code byte one beyond the end": "05 11 22 33",
    }.items():
        yield _bad(name, bytes.fromhex(chunk) + b"\0", "bad_encoding")
    stuttering = b"".join(frame[:at] + b"\0" for at in range(len(frame) - 1))
    yield _damaged("a frame begun again and again", stuttering)


def _damage(spec: Spec) -> Iterator[Case]:
    """One frame damaged in every way."""
    sample = _sample(spec)
    frame = encode_frame(sample)
    for at in range(len(frame) - 1):
        yield _damaged(f"byte {at} dropped", frame[:at] + frame[at + 1 :])
        yield _damaged(f"byte {at} doubled", frame[: at + 1] + frame[at:])
        yield _damaged(f"byte {at} zeroed", frame[:at] + b"\0" + frame[at + 1 :])
        yield _damaged(f"cut before byte {at}", frame[:at] + b"\0")
        for bit in range(8):
            yield _damaged(f"byte {at}, bit {bit} flipped", _flipped(frame, at, bit))
    body, crc = frame_content(sample)[:-2], _crc(sample)
    for name, wrong in {
        "CRC off by one": (crc + 1) & 0xFFFF,
        "CRC big-endian": int.from_bytes(crc.to_bytes(2, "little"), "big"),
        "CRC without the final inversion": crc ^ 0xFFFF,
        "CRC over the payload only": crc16_x25(sample.payload),
    }.items():
        content = body + wrong.to_bytes(2, "little")
        yield _bad(name, cobs_encode(content) + b"\0", "bad_crc")


def _flipped(stream: bytes, at: int, bit: int) -> bytes:
    return stream[:at] + bytes([stream[at] ^ (1 << bit)]) + stream[at + 1 :]
