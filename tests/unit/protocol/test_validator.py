"""Edits of the real spec that break one rule each: of its shape, and of what its parts mean."""

import inspect
import sys
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from ccr_protocol import meaning
from ccr_protocol.load import SpecError, from_tree, load, validate

from .edit import bit, field, find, remove, transition, value

Tree = dict[str, Any]
Edit = Callable[[Tree], object]

SPEC_TEXT = (Path(meaning.__file__).parents[1] / "spec.toml").read_text(encoding="utf-8")


def _set(node: Tree, **changes: object) -> None:
    node.update(changes)


def _add_message(tree: Tree, **keys: object) -> None:
    tree["message"].append({"direction": "to_host", "prose": "New.", **keys})


SHAPE: dict[str, tuple[Edit, str]] = {
    "unknown key at the top": (
        lambda t: _set(t, colour="red"),
        "colour: unknown key",
    ),
    "unknown key of a field": (
        lambda t: _set(field(t, "message", "set_target", "ramp_ms"), maximum=1),
        "message set_target, fields ramp_ms, maximum: unknown key",
    ),
    "section missing": (lambda t: t.pop("framing"), "framing: missing"),
    "key missing": (
        lambda t: field(t, "struct", "slew", "slew_cdeg_tick").pop("type"),
        "struct slew, fields slew_cdeg_tick, type: missing",
    ),
    "list instead of table": (lambda t: _set(t, eeprom=[]), "eeprom: must be a table"),
    "table instead of list": (lambda t: _set(t, enum={}), "enum: must be a list"),
    "empty list": (lambda t: _set(t, constant=[]), "constant: must not be empty"),
    "unknown integer type": (
        lambda t: _set(field(t, "message", "hello", "spec_hash"), type="u24"),
        "message hello, fields spec_hash, type: 'u24' is not one of u8, i8",
    ),
    "signed enumeration": (
        lambda t: _set(find(t, "enum", "state"), type="i8"),
        "enum state, type: i8 is signed",
    ),
    "text instead of integer": (
        lambda t: _set(find(t, "constant", "tick_us"), value="20"),
        "constant tick_us, value: must be a valid integer, not '20'",
    ),
    "boolean instead of integer": (
        lambda t: _set(find(t, "constant", "tick_us"), value=True),
        "constant tick_us, value: must be a valid integer, not True",
    ),
    "integer out of bounds": (
        lambda t: _set(find(t, "message", "hello"), id=256),
        "message hello, id: must be less than 128, not 256",
    ),
    "integer instead of boolean": (
        lambda t: _set(find(t, "message", "hello"), session=1),
        "message hello, session: must be a valid boolean, not 1",
    ),
    "scale not a number above 0": (
        lambda t: _set(field(t, "message", "set_target", "ramp_ms"), scale=0),
        "message set_target, fields ramp_ms, scale: must be a number above 0, not 0",
    ),
    "name in capitals": (
        lambda t: _set(find(t, "message", "hello"), name="Hello"),
        "message Hello, name: 'Hello' is no snake_case name",
    ),
    "name that C++ keeps": (
        lambda t: _set(field(t, "message", "hello", "spec_hash"), name="register"),
        "message hello, fields register, name: the name 'register' is taken",
    ),
    "name that Python keeps": (
        lambda t: _set(field(t, "message", "hello", "spec_hash"), name="lambda"),
        "message hello, fields lambda, name: the name 'lambda' is taken",
    ),
    "name that payloads have": (
        lambda t: _set(field(t, "message", "hello", "spec_hash"), name="pack"),
        "message hello, fields pack, name: the name 'pack' is taken",
    ),
    "empty prose": (
        lambda t: _set(find(t, "message", "hello"), prose=" "),
        "message hello, prose: must be a text that is not empty",
    ),
    "prose that ends a string": (
        lambda t: _set(find(t, "message", "hello"), prose='so-called "hello"'),
        "message hello, prose: must be printable ASCII without",
    ),
    "prose beyond ASCII": (
        lambda t: _set(find(t, "message", "hello"), prose="20 µs"),
        "message hello, prose: must be printable ASCII without",
    ),
    "requirement id": (
        lambda t: _set(t["requirement"][0], id="FRM1"),
        "requirement FRM1, id: 'FRM1' is not like FRM-1",
    ),
    "direction": (
        lambda t: _set(find(t, "message", "ack"), direction="up"),
        "message ack: direction must be 'to_board' or 'to_host'",
    ),
    "another delimiter": (
        lambda t: _set(t["framing"], delimiter=1),
        "framing, delimiter: must be 0, not 1",
    ),
    "another CRC": (
        lambda t: _set(t["framing"], crc="CRC-32"),
        "framing, crc: must be 'CRC-16/X-25', not 'CRC-32'",
    ),
    "payload beyond one COBS block": (
        lambda t: _set(t["framing"], max_payload=250),
        "framing, max_payload: must be less than or equal to 249, not 250",
    ),
    "firmware version of two numbers": (
        lambda t: _set(t["protocol"], firmware_version=[1, 0]),
        "protocol, firmware_version #3: missing",
    ),
    "states neither any nor a list": (
        lambda t: _set(find(t, "message", "arm"), states="all"),
        "message arm, states: must be a list",
    ),
    "unreadable consistency": (
        lambda t: _set(find(t, "struct", "limits"), consistent="rest is nice, for each axis"),
        "struct limits, consistent: cannot read 'rest is nice'",
    ),
    "consistency of no axis": (
        lambda t: _set(find(t, "struct", "limits"), consistent="angle_min_cdeg < rest_cdeg"),
        "struct limits, consistent: must end in ', for each axis'",
    ),
    "reply with the keys of a request": (
        lambda t: _set(find(t, "message", "ack"), retry="once"),
        "message ack, retry: unknown key",
    ),
    "request without reply": (
        lambda t: find(t, "message", "arm").pop("reply"),
        "message arm, reply: missing",
    ),
    "request without retry": (
        lambda t: find(t, "message", "arm").pop("retry"),
        "message arm, retry: missing",
    ),
    "request without states": (
        lambda t: find(t, "message", "arm").pop("states"),
        "message arm, states: missing",
    ),
    "request with the id of a reply": (
        lambda t: _set(find(t, "message", "arm"), id=0x90),
        "message arm, id: must be less than 128, not 144",
    ),
}

MEANING: dict[str, tuple[Edit, str]] = {
    "constant twice": (
        lambda t: t["constant"].append(t["constant"][0]),
        "constant tick_us: name given twice",
    ),
    "struct named like a message": (
        lambda t: (
            _set(find(t, "struct", "slew"), name="arm"),
            _set(find(t, "message", "set_slew"), struct="arm"),
            _set(find(t, "message", "slew_reply"), struct="arm"),
        ),
        "arm: two of enum, flags, struct and message have this name",
    ),
    "message named like a generated class": (
        lambda t: _add_message(t, id=0x60, name="request"),
        "request: the generated code uses this name itself",
    ),
    "requirement twice": (
        lambda t: t["requirement"].append(t["requirement"][0]),
        "requirement FRM-1: id given twice",
    ),
    "enumerator twice": (
        lambda t: _set(value(t, "fault", "internal"), name="none"),
        "enum fault, none: name given twice",
    ),
    "enumerator value twice": (
        lambda t: _set(value(t, "fault", "internal"), value=1),
        "enum fault: value 1 given twice",
    ),
    "enumerator too great": (
        lambda t: _set(value(t, "fault", "internal"), value=256),
        "enum fault, internal: 256 does not fit u8",
    ),
    "bit name twice": (
        lambda t: _set(bit(t, "capabilities", "eeprom"), name="stack_monitor"),
        "flags capabilities, stack_monitor: name given twice",
    ),
    "bit twice": (
        lambda t: _set(bit(t, "capabilities", "eeprom"), bit=1),
        "flags capabilities: bit 1 given twice",
    ),
    "bit beyond the type": (
        lambda t: _set(bit(t, "capabilities", "eeprom"), bit=16),
        "flags capabilities, eeprom: u16 has no bit 16",
    ),
    "range beyond the type": (
        lambda t: _set(field(t, "message", "set_target", "ramp_ms"), max=65536),
        "message set_target, field ramp_ms: max 65536 does not fit u16",
    ),
    "negative minimum of an unsigned field": (
        lambda t: _set(field(t, "struct", "watchdog", "arm_axis_ms"), min=-1),
        "struct watchdog, field arm_axis_ms: min -1 does not fit u16",
    ),
    "empty range": (
        lambda t: _set(field(t, "message", "set_target", "ramp_ms"), min=10001),
        "message set_target, field ramp_ms: min is above max",
    ),
    "unit without scale": (
        lambda t: field(t, "message", "set_target", "ramp_ms").pop("scale"),
        "message set_target, field ramp_ms: unit and scale come together",
    ),
    "scale without unit": (
        lambda t: field(t, "message", "set_target", "ramp_ms").pop("unit"),
        "message set_target, field ramp_ms: unit and scale come together",
    ),
    "range of an enum field": (
        lambda t: _set(field(t, "message", "ack", "state"), max=3),
        "message ack, field state: an enum or flags field has no unit, range or count",
    ),
    "enum and flags": (
        lambda t: _set(field(t, "message", "ack", "state"), flags="status_flags"),
        "message ack, field state: either enum or flags",
    ),
    "unknown enum": (
        lambda t: _set(field(t, "message", "ack", "state"), enum="mood"),
        "message ack, field state: there is no enum mood",
    ),
    "unknown flags": (
        lambda t: _set(field(t, "message", "target_reply", "flags"), flags="mood"),
        "message target_reply, field flags: there is no flags mood",
    ),
    "internal enum on the wire": (
        lambda t: _set(field(t, "message", "ack", "state"), enum="event"),
        "message ack, field state: enum event is internal",
    ),
    "enum of another type": (
        lambda t: _set(field(t, "message", "ack", "state"), type="u16"),
        "message ack, field state: enum state is u8, not u16",
    ),
    "field twice in a struct": (
        lambda t: _set(field(t, "struct", "watchdog", "arm_axis_ms"), name="relax_after_ms"),
        "struct watchdog, field relax_after_ms: name given twice",
    ),
    "field twice through a struct": (
        lambda t: _set(field(t, "struct", "slew", "slew_cdeg_tick"), name="session"),
        "message set_slew, field session: name given twice",
    ),
    "consistency of an unknown field": (
        lambda t: _set(find(t, "struct", "limits"), consistent="mood < rest_cdeg, for each axis"),
        "struct limits, consistent: there is no field mood",
    ),
    "consistency of a field without axes": (
        lambda t: _set(
            find(t, "struct", "watchdog"),
            consistent="arm_axis_ms < relax_after_ms, for each axis",
        ),
        "struct watchdog, consistent: its fields must have one element for each axis",
    ),
    "consistency of different lengths": (
        lambda t: _set(field(t, "struct", "limits", "rest_cdeg"), count=3),
        "struct limits, consistent: its fields must have one element for each axis",
    ),
    "message id twice": (
        lambda t: _set(find(t, "message", "telemetry"), id=0x71),
        "message id 0x71: given twice",
    ),
    "message without its struct": (
        lambda t: _set(find(t, "message", "telemetry"), struct="mood"),
        "message telemetry: there is no struct mood",
    ),
    "payload too long": (
        lambda t: _set(t["framing"], max_payload=29),
        "message counters_reply: 30 bytes are more than max_payload 29",
    ),
    "unknown reply": (
        lambda t: _set(find(t, "message", "arm"), reply="mood"),
        "message arm, reply: there is no message mood",
    ),
    "reply that is a request": (
        lambda t: _set(find(t, "message", "arm"), reply="stop"),
        "message arm, reply: stop does not go to the host",
    ),
    "reply with a foreign id": (
        lambda t: _set(find(t, "message", "hello_reply"), id=0x8F),
        "message hello, reply: hello_reply must have the id 0x81",
    ),
    "session asked for but not carried": (
        lambda t: _set(find(t, "message", "stop"), session=True),
        "message stop, session: its first field must be session, u16",
    ),
    "session of another type": (
        lambda t: _set(field(t, "message", "arm", "session"), type="u32"),
        "message arm, session: its first field must be session, u16",
    ),
    "session carried but not asked for": (
        lambda t: _set(find(t, "message", "arm"), session=False),
        "message arm, session: begins with a session that is not checked",
    ),
    "unknown state in a request": (
        lambda t: _set(find(t, "message", "arm"), states=["disarmed", "dancing"]),
        "message arm, states: there is no state dancing",
    ),
    "state twice in a request": (
        lambda t: _set(find(t, "message", "arm"), states=["disarmed", "disarmed"]),
        "message arm, states: disarmed given twice",
    ),
    "no nack": (lambda t: remove(t["message"], "nack"), "message nack: missing"),
    "unused struct": (
        lambda t: t["struct"].append({**find(t, "struct", "slew"), "name": "spare"}),
        "struct spare: no mandatory message uses it",
    ),
    "unused enum": (
        lambda t: t["enum"].append({**find(t, "enum", "fault"), "name": "spare"}),
        "enum spare: no mandatory message uses it",
    ),
    "struct of an optional message only": (
        lambda t: (
            t["struct"].append({**find(t, "struct", "slew"), "name": "spare"}),
            _set(find(t, "message", "link_limits_reply"), struct="spare"),
        ),
        "struct spare: no mandatory message uses it",
    ),
    "unknown capability": (
        lambda t: _set(find(t, "message", "link_limits_reply"), optional="telepathy"),
        "message link_limits_reply, optional: there is no capability telepathy",
    ),
    "mandatory request with an optional reply": (
        lambda t: find(t, "message", "get_link_limits").pop("optional"),
        "message get_link_limits, reply: link_limits_reply needs the capability link_limits",
    ),
    "no boot state": (
        lambda t: _set(value(t, "state", "boot"), name="birth"),
        "enum state: there must be a state boot",
    ),
    "transition to an unknown state": (
        lambda t: _set(transition(t, "target_expired", "hold"), to="dancing"),
        "state_machine: there is no state dancing",
    ),
    "transition by an unknown event": (
        lambda t: t["state_machine"]["transitions"].append(
            {"from": ["hold"], "event": "sneeze", "to": "fault"}
        ),
        "state_machine: there is no event sneeze",
    ),
    "ambiguous transition": (
        lambda t: t["state_machine"]["transitions"].append(
            {"from": ["active"], "event": "target_expired", "to": "relaxing"}
        ),
        "state_machine: from active, target_expired leads to two places",
    ),
    "event that moves nothing": (
        lambda t: find(t, "enum", "event")["values"].append(
            {"name": "sneeze", "value": 99, "prose": "New."}
        ),
        "state_machine: the event sneeze moves nothing",
    ),
    "unreachable state": (
        lambda t: _set(transition(t, "hold_expired", "relaxing"), to="fault"),
        "state_machine: the state relaxing cannot be reached from boot",
    ),
    "state that cannot be stopped": (
        lambda t: transition(t, "stop_requested", "stopped")["from"].remove("arming"),
        "state_machine: stop_requested must lead from arming to stopped",
    ),
    "fault that ends by itself": (
        lambda t: transition(t, "self_test_passed", "disarmed")["from"].append("fault"),
        "state_machine: fault is latched, self_test_passed must not end it",
    ),
    "no struct for the configuration": (
        lambda t: (
            _set(find(t, "struct", "slew"), name="speed"),
            _set(find(t, "message", "set_slew"), struct="speed"),
            _set(find(t, "message", "slew_reply"), struct="speed"),
        ),
        "eeprom: the configuration needs the struct slew",
    ),
    "EEPROM slots overlap": (
        lambda t: _set(t["eeprom"], slot_b=69),
        "eeprom: slot_a (70 bytes) reaches into slot_b",
    ),
    "boot counter in a slot": (
        lambda t: _set(t["eeprom"], boot_counter=127),
        "eeprom: boot_counter (64 bytes) reaches into slot_b",
    ),
    "EEPROM too small": (
        lambda t: _set(t["eeprom"], size=257),
        "eeprom: boot_counter ends beyond the 257 bytes there are",
    ),
}


def test_the_spec_is_valid(tree: Tree) -> None:
    assert validate(tree) == []


@pytest.mark.parametrize(("edit", "expected"), SHAPE.values(), ids=SHAPE.keys())
def test_a_wrong_shape_gets_one_line_with_its_place(tree: Tree, edit: Edit, expected: str) -> None:
    edit(tree)
    assert [line[: len(expected)] for line in validate(tree)] == [expected]


@pytest.mark.parametrize(("edit", "expected"), MEANING.values(), ids=MEANING.keys())
def test_a_contradiction_is_told_with_its_place(tree: Tree, edit: Edit, expected: str) -> None:
    edit(tree)
    lines = validate(tree)
    assert any(line.startswith(expected) for line in lines), lines
    assert all("\n" not in line for line in lines)


@pytest.mark.long
def test_every_rule_has_an_edit_that_breaks_it() -> None:
    """A rule that no edit reaches would be a rule without a test."""
    lines = inspect.getsource(meaning).splitlines()
    rules = {number for number, line in enumerate(lines, start=1) if 'f"' in line}
    assert len(rules) > 10
    assert rules - _lines_reached(str(meaning.__file__), MEANING.values()) == set()


def _lines_reached(file: str, edits: Iterable[tuple[Edit, str]]) -> set[int]:
    reached: set[int] = set()

    def trace(frame: FrameType, _event: str, _argument: object) -> Any:
        if frame.f_code.co_filename != file:
            return None
        reached.add(frame.f_lineno)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        for edit, _ in edits:
            changed = tomllib.loads(SPEC_TEXT)
            edit(changed)
            validate(changed)
    finally:
        sys.settrace(before)
    return reached


def test_a_bad_spec_is_refused_with_all_its_problems(tree: Tree) -> None:
    find(tree, "message", "arm")["states"] = ["dancing"]
    tree["eeprom"]["slot_b"] = 1
    with pytest.raises(SpecError) as refusal:
        from_tree(tree)
    assert len(refusal.value.problems) == 2


@pytest.mark.parametrize("content", [b"= nonsense", b"\xff\xfe", None])
def test_a_file_that_is_no_toml_is_refused_by_name(tmp_path, content: bytes | None) -> None:
    path = tmp_path / "broken.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SpecError, match=r"broken\.toml"):
        load(path)
