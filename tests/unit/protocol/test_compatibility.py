"""Each rule of compatibility has an edit of the spec that breaks it."""

import copy
import shutil
from collections.abc import Callable
from typing import Any

import pytest

import check_compatibility
from ccr_host.link.messages import PROTOCOL_VERSION
from ccr_protocol.load import from_tree

from .conftest import PROTOCOL
from .edit import bit, field, find, remove, transition, value

Tree = dict[str, Any]
Edit = Callable[[Tree], object]


@pytest.fixture
def tree(tree: Tree) -> Tree:
    """The spec as if it were version 1, whatever it is."""
    tree["protocol"]["version"] = 1
    return tree


def _rename(tree: Tree, kind: str, old: str, new: str) -> None:
    find(tree, kind, old)["name"] = new


def _move_hello(tree: Tree) -> None:
    find(tree, "message", "hello")["id"] = 0x60
    find(tree, "message", "hello_reply")["id"] = 0xE0


def _longer_slot_under_a_new_id(tree: Tree) -> None:
    for message, number in {"set_slew": 0x50, "get_slew": 0x51, "slew_reply": 0xD1}.items():
        find(tree, "message", message)["id"] = number
    extra = {**field(tree, "struct", "slew", "slew_cdeg_tick"), "name": "jerk"}
    del extra["count"]
    find(tree, "struct", "slew")["fields"].append(extra)


NEVER: dict[str, tuple[Edit, str]] = {
    "version goes back": (
        lambda t: t["protocol"].update(version=1),
        "protocol version 1 is below the released 2",
    ),
    "id given to another message": (
        lambda t: _rename(t, "message", "telemetry", "report"),
        "id 0xC1: was telemetry, must not become report",
    ),
    "type of a field": (
        lambda t: field(t, "message", "set_target", "ramp_ms").update(type="i16"),
        "id 0x20 set_target, field 2 ramp_ms: differs in more than its range",
    ),
    "count of a field": (
        lambda t: field(t, "message", "hello_reply", "firmware_version").update(count=4),
        "id 0x81 hello_reply, field 2 firmware_version: differs",
    ),
    "unit of a field": (
        lambda t: field(t, "message", "set_target", "ramp_ms").update(unit="us"),
        "id 0x20 set_target, field 2 ramp_ms: differs",
    ),
    "scale of a field": (
        lambda t: field(t, "struct", "slew", "slew_cdeg_tick").update(scale=0.1),
        "id 0x33 set_slew, field 1 slew_cdeg_tick: differs",
    ),
    "name of a field": (
        lambda t: field(t, "message", "nack", "detail").update(name="hint"),
        "id 0x71 nack, field 2 detail: differs",
    ),
    "enum of a field": (
        lambda t: field(t, "message", "ack", "state").update(enum="fault"),
        "id 0x70 ack, field 1 state: differs",
    ),
    "order of fields": (
        lambda t: find(t, "message", "nack")["fields"].reverse(),
        "id 0x71 nack, field 0 request: differs",
    ),
    "one field more": (
        lambda t: find(t, "message", "nack")["fields"].append(
            {"name": "hint", "type": "u8", "prose": "New."}
        ),
        "id 0x71 nack: has 4 instead of 3 fields; take a new id",
    ),
    "value given to another enumerator": (
        lambda t: value(t, "fault", "internal").update(name="gremlin"),
        "enum fault, internal = 7: the value must not be given to gremlin",
    ),
    "enumerator with another value": (
        lambda t: value(t, "fault", "internal").update(value=99),
        "enum fault, internal = 7: must not become 99",
    ),
    "integer of an internal enum": (
        lambda t: find(t, "enum", "event").update(type="u16"),
        "enum event: u8 must not become u16",
    ),
    "integer of flags": (
        lambda t: (
            find(t, "flags", "capabilities").update(type="u32"),
            field(t, "message", "hello_reply", "capabilities").update(type="u32"),
        ),
        "flags capabilities: u16 must not become u32",
    ),
    "bit given to another flag": (
        lambda t: bit(t, "status_flags", "moving").update(name="dancing"),
        "flags status_flags, moving = bit 2: the bit must not be given to dancing",
    ),
    "flag with another bit": (
        lambda t: bit(t, "capabilities", "stack_monitor").update(bit=9),
        "flags capabilities, stack_monitor = bit 2: must not become bit 9",
    ),
    "hello under another id": (_move_hello, "message hello: must keep the id 0x01"),
    "enumerator that older hosts cannot read in hello_reply": (
        lambda t: find(t, "enum", "reset_cause")["values"].append(
            {"name": "gremlin", "value": 5, "prose": "New."}
        ),
        "enum reset_cause, gremlin: older hosts could not read hello_reply",
    ),
    "message in the other direction": (
        lambda t: (
            find(t, "message", "clock_sync").update(direction="to_host"),
            [find(t, "message", "clock_sync").pop(k) for k in ("reply", "retry", "session")],
            find(t, "message", "clock_sync").pop("states"),
        ),
        "id 0x03 clock_sync: goes in the other direction",
    ),
    "saved configuration under the same layout": (
        _longer_slot_under_a_new_id,
        "eeprom: the saved configuration differs, eeprom.layout must be another",
    ),
}

NEW_VERSION: dict[str, tuple[Edit, str]] = {
    "baud": (lambda t: t["framing"].update(baud=500000), "framing, baud: 250000 has become 500000"),
    "longest payload": (
        lambda t: t["framing"].update(max_payload=64),
        "framing, max_payload: 48 has become 64",
    ),
    "constant": (
        lambda t: find(t, "constant", "tick_us").update(value=10000),
        "constant tick_us: has changed or gone",
    ),
    "constant gone": (
        lambda t: remove(t["constant"], "boot_ticks"),
        "constant boot_ticks: has changed or gone",
    ),
    "enumerator new": (
        lambda t: find(t, "enum", "fault")["values"].append(
            {"name": "gremlin", "value": 99, "prose": "New."}
        ),
        "enum fault, gremlin: is new",
    ),
    "enumerator gone": (
        lambda t: remove(find(t, "enum", "reset_cause")["values"], "watchdog"),
        "enum reset_cause, watchdog: is gone",
    ),
    "flag gone": (
        lambda t: remove(find(t, "flags", "capabilities")["bits"], "eeprom"),
        "flags capabilities, eeprom: is gone",
    ),
    "message gone": (
        lambda t: remove(t["message"], "get_counters"),
        "message get_counters is gone",
    ),
    "message under another id": (
        lambda t: find(t, "message", "telemetry").update(id=0xC7),
        "message telemetry: its id has become 0xC7",
    ),
    "retry": (
        lambda t: find(t, "message", "arm").update(retry="repeat"),
        "message arm: reply, retry, session or states have changed",
    ),
    "optional message made mandatory": (
        lambda t: [
            find(t, "message", name).pop("optional")
            for name in ("get_link_limits", "link_limits_reply")
        ],
        "message get_link_limits: must stay optional (link_limits)",
    ),
    "mandatory message made optional": (
        lambda t: find(t, "message", "blink").update(optional="link_limits"),
        "message blink: must stay mandatory",
    ),
    "states": (
        lambda t: find(t, "message", "arm").update(states=["disarmed", "fault"]),
        "message arm: reply, retry, session or states have changed",
    ),
    "narrower above": (
        lambda t: field(t, "message", "set_target", "ramp_ms").update(max=9999),
        "message set_target, ramp_ms: 0 to 9999 is narrower than before",
    ),
    "narrower below": (
        lambda t: field(t, "struct", "slew", "slew_cdeg_tick").update(min=20),
        "message set_slew, slew_cdeg_tick: 20 to 2000 is narrower than before",
    ),
    "consistency": (
        lambda t: find(t, "struct", "limits").pop("consistent"),
        "message set_limits: its consistency rule has changed",
    ),
    "transition": (
        lambda t: transition(t, "rest_reached", "fault").update(to="disarmed"),
        "state machine: a transition has changed",
    ),
    "EEPROM address": (
        lambda t: t["eeprom"].update(slot_b=100),
        "eeprom: the layout has changed",
    ),
}

FREE: dict[str, Edit] = {
    "nothing": lambda t: None,
    "prose": lambda t: find(t, "message", "arm").update(prose="Arms."),
    "requirement": lambda t: t["requirement"].append({"id": "NEW-1", "text": "Shines."}),
    "firmware version": lambda t: t["protocol"].update(firmware_version=[9, 0, 0]),
    "wider range": lambda t: field(t, "message", "set_target", "ramp_ms").update(max=20000),
    "new message": lambda t: t["message"].append(
        {"id": 0xD5, "name": "log", "direction": "to_host", "prose": "New."}
    ),
    "new flag": lambda t: find(t, "flags", "capabilities")["bits"].append(
        {"name": "radio", "bit": 9, "prose": "New."}
    ),
    "new constant": lambda t: t["constant"].append(
        {"name": "answer", "value": 42, "unit": "tick", "prose": "New."}
    ),
}


def _violations(released: Tree, edit: Edit, *, version: int) -> list[str]:
    changed = copy.deepcopy(released)
    changed["protocol"]["version"] = version
    edit(changed)
    return check_compatibility.violations([from_tree(released)], from_tree(changed))


@pytest.mark.parametrize(("edit", "expected"), NEVER.values(), ids=NEVER.keys())
def test_not_even_a_new_version_allows(tree: Tree, edit: Edit, expected: str) -> None:
    tree["protocol"]["version"] = 2
    lines = _violations(tree, edit, version=3)
    assert any(line.startswith(expected) for line in lines), lines


@pytest.mark.parametrize(("edit", "expected"), NEW_VERSION.values(), ids=NEW_VERSION.keys())
def test_only_a_new_version_allows(tree: Tree, edit: Edit, expected: str) -> None:
    assert f"{expected}; raise protocol.version above 1" in _violations(tree, edit, version=1)
    assert _violations(tree, edit, version=2) == []


@pytest.mark.parametrize("edit", FREE.values(), ids=FREE.keys())
def test_the_same_version_allows(tree: Tree, edit: Edit) -> None:
    assert _violations(tree, edit, version=1) == []


def test_an_id_that_an_older_release_had_is_not_used_again(tree: Tree) -> None:
    first = from_tree(tree)
    without = copy.deepcopy(tree)
    without["protocol"]["version"] = 2
    remove(without["message"], "get_counters")
    second = from_tree(without)
    reused = copy.deepcopy(without)
    reused["protocol"]["version"] = 3
    request = {**find(tree, "message", "get_state"), "name": "get_mood", "id": 0x05}
    reused["message"].append({**request, "reply": "mood_reply"})
    remove(reused["message"], "counters_reply")
    reply = find(tree, "message", "counters_reply")
    reused["message"].append({**reply, "name": "mood_reply"})
    assert check_compatibility.violations([first, second], from_tree(reused)) == [
        "id 0x05: was get_counters, must not become get_mood",
        "id 0x85: was counters_reply, must not become mood_reply",
    ]


def test_the_spec_is_compatible_with_what_was_released(capsys) -> None:
    assert check_compatibility.main([]) == 0
    assert capsys.readouterr().err == ""


def test_the_command_names_what_is_not_allowed_and_fails(tmp_path, capsys) -> None:
    released = tmp_path / "released"
    released.mkdir()
    shutil.copy(PROTOCOL / "spec.toml", released)
    spec = tmp_path / "spec.toml"
    text = (PROTOCOL / "spec.toml").read_text(encoding="utf-8")
    spec.write_text(text.replace("baud = 250000", "baud = 500000"), encoding="utf-8")
    arguments = ["--spec", str(spec), "--released", str(released)]
    assert check_compatibility.main(arguments) == 1
    assert capsys.readouterr().err == (
        "framing, baud: 250000 has become 500000; "
        f"raise protocol.version above {PROTOCOL_VERSION}\n"
    )


def test_without_a_released_spec_the_command_fails(tmp_path, capsys) -> None:
    assert check_compatibility.main(["--released", str(tmp_path)]) == 2
    assert "no released spec" in capsys.readouterr().err
