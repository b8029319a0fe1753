"""The worked example of the reference: frames taken apart byte by byte."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ccr_protocol.codec import Frame, Value, elements, encode_frame, frame_content, pack
from ccr_protocol.spec import Field, Message, Spec

SESSION = 0x4D2A
_BOOT_ID = 17

_NOT_A_FIELD = "\N{EN DASH}"


@dataclass(frozen=True)
class _Step:
    message: str
    sequence: int
    values: Mapping[str, Value]


def generate(spec: Spec) -> str:
    """Markdown of the exchange."""
    return "\n\n".join(_frame_table(step, spec) for step in _steps(spec))


def _steps(spec: Spec) -> Iterator[_Step]:
    state = {value.name: value.value for value in spec.enum_by_name["state"].values}
    hello = {"protocol_version": spec.version, "spec_hash": spec.hash}
    identity: dict[str, Value] = {
        **hello,
        "firmware_version": spec.firmware_version,
        "boot_id": _BOOT_ID,
        "reset_cause": _enumerator(spec, "reset_cause", "external"),
        "eeprom_status": _enumerator(spec, "eeprom_status", "loaded"),
        "capabilities": 0b111,
        "axes": 2,
        "max_payload": spec.framing.max_payload,
        "tick_us": next(c.value for c in spec.constants if c.name == "tick_us"),
    }
    target = [1200, -450]
    arm = spec.message_by_name["arm"].id
    standing = _bits(spec, "axis_1_pulses", "axis_2_pulses", "configured", "session_open")
    yield _Step("hello", 0, hello)
    yield _Step("hello_reply", 0, identity)
    yield _Step("open_session", 1, {"spec_hash": spec.hash, "session": SESSION})
    yield _Step(
        "session_reply",
        1,
        {"session": SESSION, "boot_id": _BOOT_ID, "state": state["disarmed"]},
    )
    yield _Step("arm", 2, {"session": SESSION})
    yield _Step("ack", 2, {"request": arm, "state": state["arming"]})
    yield _Step(
        "set_target",
        3,
        {"session": SESSION, "target_cdeg": target, "ramp_ms": 1000, "validity_ms": 2500},
    )
    yield _Step(
        "target_reply",
        3,
        {
            "state": state["active"],
            "flags": standing,
            "target_cdeg": target,
        },
    )


def _enumerator(spec: Spec, enum: str, name: str) -> int:
    return next(value.value for value in spec.enum_by_name[enum].values if value.name == name)


def _bits(spec: Spec, *names: str) -> int:
    flags = next(flags for flags in spec.flag_sets if flags.name == "status_flags")
    return sum(1 << bit.bit for bit in flags.bits if bit.name in names)


def _frame_table(step: _Step, spec: Spec) -> str:
    message = spec.message_by_name[step.message]
    frame = Frame(message.id, step.sequence, pack(message.wire_fields, step.values))
    arrow = "host to board" if message.rules else "board to host"
    wire = encode_frame(frame)
    rows = [
        f"| `{shown}` | `{content.hex(' ')}` | {meaning} |"
        if content
        else f"| `{shown}` | {_NOT_A_FIELD} | {meaning} |"
        for shown, content, meaning in _rows(message, frame, step.values, spec)
    ]
    return "\n".join(
        [
            f"**{arrow}: `{message.name}`**",
            "",
            f"`{wire.hex(' ')}`",
            "",
            "| wire | decoded | meaning |",
            "|---|---|---|",
            *rows,
        ]
    )


def _rows(
    message: Message, frame: Frame, values: Mapping[str, Value], spec: Spec
) -> Iterator[tuple[str, bytes, str]]:
    wire, content = encode_frame(frame), frame_content(frame)
    yield f"[{wire[0]:02x}]", b"", f"{wire[0]} bytes further is the first code byte or the end"
    at = 0
    for size, meaning in _parts(message, frame, values, spec):
        part = content[at : at + size]
        # Each content byte stands one place further on the wire, behind the first code byte.
        on_wire = wire[at + 1 : at + 1 + size]
        yield _bracketed(part, on_wire), part, meaning
        at += size
    yield f"{wire[-1]:02x}", b"", "end of frame"


def _bracketed(content: bytes, wire: bytes) -> str:
    pairs = zip(content, wire, strict=True)
    return " ".join(f"{sent:02x}" if byte else f"[{sent:02x}]" for byte, sent in pairs)


def _parts(
    message: Message, frame: Frame, values: Mapping[str, Value], spec: Spec
) -> Iterator[tuple[int, str]]:
    yield 1, f"id of `{message.name}`"
    yield 1, f"sequence number {frame.sequence}"
    for field in message.wire_fields:
        yield (
            field.size,
            f"`{field.name}` = {_value_text(field, elements(values[field.name]), spec)}",
        )
    yield 2, "CRC-16/X-25 of what is before"


def _value_text(field: Field, numbers: Sequence[int], spec: Spec) -> str:
    if field.enum:
        enum = spec.enum_by_name[field.enum]
        return next(f"`{value.name}`" for value in enum.values if value.value == numbers[0])
    if field.flags:
        flags = next(flags for flags in spec.flag_sets if flags.name == field.flags)
        names = [f"`{bit.name}`" for bit in flags.bits if numbers[0] >> bit.bit & 1]
        return ", ".join(names) or "none"
    if field.unit:
        return f"{', '.join(f'{number * field.scale:g}' for number in numbers)} {field.unit}"
    if field.name in {"spec_hash", "session", "request"}:
        return f"0x{numbers[0]:0{2 * field.type.size}X}"
    return ", ".join(map(str, numbers))
