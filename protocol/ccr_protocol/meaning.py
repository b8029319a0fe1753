"""What the parts of a spec must be to each other. The tree has already passed `shape`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

from ccr_protocol import consistency
from ccr_protocol.build import FIRST_CONFIGURATION, slot_size
from ccr_protocol.spec import INTEGER_TYPES, REPLY_BIT, IntegerType

Tree = Mapping[str, Any]

_REQUEST_KEYS = ("reply", "retry", "session", "states")
_GENERATED_CLASSES = frozenset({"field", "message", "payload", "request", "retry"})
_LATCHED_STATES = frozenset({"fault", "stopped"})
_EVENTS_OUT_OF_LATCHED_STATES = frozenset({"clear_requested", "stop_requested"})
_BOOT_COUNTER_SIZE = 2


def problems(tree: Tree) -> Iterator[str]:
    """One line for each contradiction."""
    yield from _names(tree)
    yield from _enumerations(tree)
    yield from _flag_sets(tree)
    yield from _structs(tree)
    yield from _messages(tree)
    yield from _unused(tree)
    yield from _state_machine(tree)
    yield from _eeprom(tree)


def _repeated(values: Iterable[Any]) -> list[Any]:
    return [value for value, times in Counter(values).items() if times > 1]


def _names(tree: Tree) -> Iterator[str]:
    for name in _repeated(node["name"] for node in tree["constant"]):
        yield f"constant {name}: name given twice"
    kinds = ("enum", "flags", "struct", "message")
    names = [node["name"] for kind in kinds for node in tree[kind]]
    for name in _repeated(names):
        yield f"{name}: two of enum, flags, struct and message have this name"
    for name in sorted(_GENERATED_CLASSES.intersection(names)):
        yield f"{name}: the generated code uses this name itself"
    for requirement in _repeated(node["id"] for node in tree["requirement"]):
        yield f"requirement {requirement}: id given twice"


def _enumerations(tree: Tree) -> Iterator[str]:
    for node in tree["enum"]:
        place = f"enum {node['name']}"
        integer = INTEGER_TYPES[node["type"]]
        for name in _repeated(value["name"] for value in node["values"]):
            yield f"{place}, {name}: name given twice"
        for number in _repeated(value["value"] for value in node["values"]):
            yield f"{place}: value {number} given twice"
        for value in node["values"]:
            if not integer.holds(value["value"]):
                yield f"{place}, {value['name']}: {value['value']} does not fit {integer.name}"


def _flag_sets(tree: Tree) -> Iterator[str]:
    for node in tree["flags"]:
        place = f"flags {node['name']}"
        bits = 8 * INTEGER_TYPES[node["type"]].size
        for name in _repeated(bit["name"] for bit in node["bits"]):
            yield f"{place}, {name}: name given twice"
        for number in _repeated(bit["bit"] for bit in node["bits"]):
            yield f"{place}: bit {number} given twice"
        for bit in node["bits"]:
            if bit["bit"] >= bits:
                yield f"{place}, {bit['name']}: {node['type']} has no bit {bit['bit']}"


def _fields(nodes: Iterable[Tree], place: str, tree: Tree) -> Iterator[str]:
    for node in nodes:
        where = f"{place}, field {node['name']}"
        integer = INTEGER_TYPES[node["type"]]
        for key in ("min", "max"):
            if key in node and not integer.holds(node[key]):
                yield f"{where}: {key} {node[key]} does not fit {integer.name}"
        if node.get("min", integer.minimum) > node.get("max", integer.maximum):
            yield f"{where}: min is above max"
        if ("unit" in node) != ("scale" in node):
            yield f"{where}: unit and scale come together"
        yield from _field_meaning(node, where, integer, tree)


def _field_meaning(node: Tree, where: str, integer: IntegerType, tree: Tree) -> Iterator[str]:
    kinds = [kind for kind in ("enum", "flags") if kind in node]
    if kinds and {"unit", "scale", "min", "max", "count"} & node.keys():
        yield f"{where}: an enum or flags field has no unit, range or count"
    if len(kinds) > 1:
        yield f"{where}: either enum or flags"
    for kind in kinds:
        found = [other for other in tree[kind] if other["name"] == node[kind]]
        if not found:
            yield f"{where}: there is no {kind} {node[kind]}"
        elif found[0].get("internal"):
            yield f"{where}: {kind} {node[kind]} is internal"
        elif found[0]["type"] != integer.name:
            yield f"{where}: {kind} {node[kind]} is {found[0]['type']}, not {integer.name}"


def _structs(tree: Tree) -> Iterator[str]:
    for node in tree["struct"]:
        place = f"struct {node['name']}"
        yield from _fields(node["fields"], place, tree)
        yield from _repeated_fields(node["fields"], place)
        if "consistent" in node:
            yield from _consistency(node, place)


def _repeated_fields(nodes: Iterable[Tree], place: str) -> Iterator[str]:
    for name in _repeated(node["name"] for node in nodes):
        yield f"{place}, field {name}: name given twice"


def _consistency(node: Tree, place: str) -> Iterator[str]:
    try:
        clauses = consistency.parse(node["consistent"])
    except ValueError as error:
        yield f"{place}, consistent: {error}"
        return
    counts = {field["name"]: field.get("count", 1) for field in node["fields"]}
    mentioned = [name for clause in clauses for name in clause.fields]
    unknown = sorted(set(mentioned) - counts.keys())
    if unknown:
        yield f"{place}, consistent: there is no field {', '.join(unknown)}"
    elif len({counts[name] for name in mentioned}) > 1 or counts[mentioned[0]] == 1:
        yield f"{place}, consistent: its fields must have one element for each axis"


def _messages(tree: Tree) -> Iterator[str]:
    for number in _repeated(node["id"] for node in tree["message"]):
        yield f"message id 0x{number:02X}: given twice"
    messages = {node["name"]: node for node in tree["message"]}
    structs = {node["name"]: node for node in tree["struct"]}
    states = _values(tree, "state")
    for node in tree["message"]:
        place = f"message {node['name']}"
        yield from _payload(node, structs, place, tree)
        if node["direction"] == "to_board":
            yield from _request(node, messages, states, place)
        else:
            for key in _REQUEST_KEYS:
                if key in node:
                    yield f"{place}, {key}: only requests have it"
    for required in ("hello", "hello_reply", "ack", "nack"):
        if required not in messages:
            yield f"message {required}: missing"


def _payload(node: Tree, structs: Mapping[str, Tree], place: str, tree: Tree) -> Iterator[str]:
    own = node.get("fields", [])
    yield from _fields(own, place, tree)
    if "struct" in node and node["struct"] not in structs:
        yield f"{place}: there is no struct {node['struct']}"
        return
    fields = own + (structs[node["struct"]]["fields"] if "struct" in node else [])
    yield from _repeated_fields(fields, place)
    limit = tree["framing"]["max_payload"]
    if _size(fields) > limit:
        yield f"{place}: {_size(fields)} bytes are more than max_payload {limit}"


def _size(fields: Iterable[Tree]) -> int:
    return sum(INTEGER_TYPES[field["type"]].size * field.get("count", 1) for field in fields)


def _request(
    node: Tree, messages: Mapping[str, Tree], states: frozenset[str], place: str
) -> Iterator[str]:
    for key in _REQUEST_KEYS:
        if key not in node:
            yield f"{place}, {key}: missing"
    if node["id"] >= REPLY_BIT:
        yield f"{place}: the id of a request is below 0x{REPLY_BIT:02X}"
    yield from _reply(node, messages, place)
    yield from _session(node, place)
    if node.get("states", "any") != "any":
        for state in sorted(set(node["states"]) - states):
            yield f"{place}, states: there is no state {state}"
        for state in _repeated(node["states"]):
            yield f"{place}, states: {state} given twice"


def _reply(node: Tree, messages: Mapping[str, Tree], place: str) -> Iterator[str]:
    name = node.get("reply")
    if name is None:
        return
    reply = messages.get(name)
    if reply is None:
        yield f"{place}, reply: there is no message {name}"
    elif reply["direction"] != "to_host":
        yield f"{place}, reply: {name} does not go to the host"
    elif name != "ack" and reply["id"] != node["id"] + REPLY_BIT:
        expected = node["id"] + REPLY_BIT
        yield f"{place}, reply: {name} must have the id 0x{expected:02X}"


def _session(node: Tree, place: str) -> Iterator[str]:
    first = next(iter(node.get("fields", ())), {"name": "", "type": ""})
    begins_with_session = first["name"] == "session"
    if node.get("session") and not (begins_with_session and first["type"] == "u16"):
        yield f"{place}, session: its first field must be session, u16"
    if not node.get("session") and begins_with_session:
        yield f"{place}, session: begins with a session that is not checked"


def _unused(tree: Tree) -> Iterator[str]:
    fields = [
        field
        for kind in ("struct", "message")
        for node in tree[kind]
        for field in node.get("fields", ())
    ]
    used = {
        "enum": {field.get("enum") for field in fields},
        "struct": {node.get("struct") for node in tree["message"]},
        # Bits of the detail of a nack; no field can carry them by type.
        "flags": {field.get("flags") for field in fields} | {"config_groups"},
    }
    for kind, names in used.items():
        for node in tree[kind]:
            if node["name"] not in names and not node.get("internal"):
                yield f"{kind} {node['name']}: nothing uses it"


def _values(tree: Tree, enum: str) -> frozenset[str]:
    return frozenset(
        value["name"] for node in tree["enum"] if node["name"] == enum for value in node["values"]
    )


def _state_machine(tree: Tree) -> Iterator[str]:
    states, events = _values(tree, "state"), _values(tree, "event")
    place = "state_machine"
    for required in sorted({"boot", "fault", "stopped"} - states):
        yield f"enum state: there must be a state {required}"
        return
    arrows = [
        (source, node["event"], node["to"])
        for node in tree["state_machine"]["transitions"]
        for source in node["from"]
    ]
    for unknown in sorted({s for a in arrows for s in (a[0], a[2])} - states):
        yield f"{place}: there is no state {unknown}"
    for unknown in sorted({event for _, event, _ in arrows} - events):
        yield f"{place}: there is no event {unknown}"
    for source, event in _repeated((source, event) for source, event, _ in arrows):
        yield f"{place}: from {source}, {event} leads to two places"
    for event in sorted(events - {event for _, event, _ in arrows}):
        yield f"{place}: the event {event} moves nothing"
    for state in sorted(states - _reachable("boot", arrows)):
        yield f"{place}: the state {state} cannot be reached from boot"
    stoppable = {source for source, *rest in arrows if rest == ["stop_requested", "stopped"]}
    for state in sorted(states - stoppable - {"stopped"}):
        yield f"{place}: stop_requested must lead from {state} to stopped"
    for source, event, _ in arrows:
        if source in _LATCHED_STATES and event not in _EVENTS_OUT_OF_LATCHED_STATES:
            yield f"{place}: {source} is latched, {event} must not end it"


def _reachable(start: str, arrows: list[tuple[str, str, str]]) -> set[str]:
    reached = {start}
    while more := {to for source, _, to in arrows if source in reached} - reached:
        reached |= more
    return reached


def _eeprom(tree: Tree) -> Iterator[str]:
    node = tree["eeprom"]
    sizes = {struct["name"]: _size(struct["fields"]) for struct in tree["struct"]}
    configuration = node.get("configuration", FIRST_CONFIGURATION)
    missing = [name for name in configuration if name not in sizes]
    if missing:
        yield f"eeprom: the configuration needs the struct {', '.join(missing)}"
        return
    slot = slot_size(sizes, configuration)
    areas = sorted(
        [
            (node["slot_a"], slot, "slot_a"),
            (node["slot_b"], slot, "slot_b"),
            (
                node["boot_counter"],
                _BOOT_COUNTER_SIZE * node.get("boot_counters", 1),
                "boot_counter",
            ),
        ]
    )
    for (start, size, name), (after, _, next_name) in pairwise(areas):
        if start + size > after:
            yield f"eeprom: {name} ({size} bytes) reaches into {next_name}"
    start, size, name = areas[-1]
    if start + size > node["size"]:
        yield f"eeprom: {name} ends beyond the {node['size']} bytes there are"
