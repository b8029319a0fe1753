"""From the TOML tree, known to be valid, to the `Spec`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

from ccr_protocol import consistency
from ccr_protocol.spec import (
    INTEGER_TYPES,
    Bit,
    Constant,
    Eeprom,
    Enumeration,
    Enumerator,
    Field,
    FlagSet,
    Framing,
    Message,
    RequestRules,
    Requirement,
    Spec,
    Struct,
    Transition,
)

Tree = Mapping[str, Any]

FIRST_CONFIGURATION = ("limits", "slew", "watchdog", "calibration")
"""Structs in an EEPROM slot where a spec does not say which, in this order."""

SLOT_HEADER = ("u16", "u8", "u16")
"""Magic, layout and generation, before the configuration."""

SLOT_TRAILER = ("u32",)
"""The CRC-32, after it."""

_PROSE_KEYS = frozenset({"prose", "text"})
_LISTS_IN_ANY_ORDER = ("constant", "enum", "flags", "struct", "message")


def spec_hash(tree: Tree) -> int:
    """32 bits of SHA-256 over what matters on the wire and in the board's behaviour.

    Prose, the wording of requirements, the firmware's version and the order of definitions are
    left out; the order of fields counts.
    """
    meaning = {key: value for key, value in tree.items() if key != "requirement"}
    meaning["protocol"] = {k: v for k, v in tree["protocol"].items() if k != "firmware_version"}
    for key in _LISTS_IN_ANY_ORDER:
        meaning[key] = sorted(tree[key], key=lambda node: str(node["name"]))
    meaning["state_machine"] = sorted(
        (source, node["event"], node["to"])
        for node in tree["state_machine"]["transitions"]
        for source in node["from"]
    )
    canonical = json.dumps(_without_prose(meaning), sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(canonical.encode()).digest()[:4], "big")


def _without_prose(node: Any) -> Any:  # noqa: ANN401 - any TOML value
    if isinstance(node, Mapping):
        return {k: _without_prose(v) for k, v in node.items() if k not in _PROSE_KEYS}
    if isinstance(node, list):
        return [_without_prose(value) for value in node]
    return node


def build(tree: Tree) -> Spec:
    """Make the `Spec` of a valid tree."""
    structs = {node["name"]: _struct(node) for node in tree["struct"]}
    states = tuple(v["name"] for e in tree["enum"] if e["name"] == "state" for v in e["values"])
    protocol = tree["protocol"]
    major, minor, patch = protocol["firmware_version"]
    return Spec(
        name=protocol["name"],
        version=protocol["version"],
        firmware_version=(major, minor, patch),
        prose=_prose(protocol),
        framing=Framing(**{**tree["framing"], "prose": _prose(tree["framing"])}),
        constants=tuple(
            Constant(n["name"], n["value"], n["unit"], _prose(n)) for n in tree["constant"]
        ),
        enums=tuple(_enumeration(node) for node in tree["enum"]),
        flag_sets=tuple(_flag_set(node) for node in tree["flags"]),
        structs=tuple(structs.values()),
        messages=tuple(_message(node, structs, states) for node in tree["message"]),
        transitions=tuple(
            Transition(source, node["event"], node["to"])
            for node in tree["state_machine"]["transitions"]
            for source in node["from"]
        ),
        eeprom=_eeprom(tree["eeprom"], structs),
        requirements=tuple(Requirement(n["id"], n["text"]) for n in tree["requirement"]),
        hash=spec_hash(tree),
    )


def _prose(node: Tree) -> str:
    return " ".join(node["prose"].split())


def _enumeration(node: Tree) -> Enumeration:
    return Enumeration(
        node["name"],
        INTEGER_TYPES[node["type"]],
        _prose(node),
        tuple(Enumerator(v["name"], v["value"], _prose(v)) for v in node["values"]),
        internal=node.get("internal", False),
    )


def _flag_set(node: Tree) -> FlagSet:
    return FlagSet(
        node["name"],
        INTEGER_TYPES[node["type"]],
        _prose(node),
        tuple(Bit(b["name"], b["bit"], _prose(b)) for b in node["bits"]),
    )


def _field(node: Tree) -> Field:
    return Field(
        name=node["name"],
        type=INTEGER_TYPES[node["type"]],
        prose=_prose(node),
        count=node.get("count", 1),
        unit=node.get("unit", ""),
        scale=node.get("scale", 1),
        minimum=node.get("min"),
        maximum=node.get("max"),
        enum=node.get("enum"),
        flags=node.get("flags"),
    )


def _struct(node: Tree) -> Struct:
    rule = node.get("consistent")
    return Struct(
        node["name"],
        _prose(node),
        tuple(_field(field) for field in node["fields"]),
        consistency.parse(rule) if rule else (),
    )


def _message(node: Tree, structs: Mapping[str, Struct], states: tuple[str, ...]) -> Message:
    rules = None
    if node["direction"] == "to_board":
        allowed = states if node["states"] == "any" else tuple(node["states"])
        rules = RequestRules(node["reply"], node["retry"], node["session"], allowed)
    return Message(
        id=node["id"],
        name=node["name"],
        prose=_prose(node),
        fields=tuple(_field(field) for field in node.get("fields", ())),
        struct=structs[node["struct"]] if "struct" in node else None,
        rules=rules,
    )


def slot_size(struct_sizes: Mapping[str, int], configuration: Iterable[str]) -> int:
    """Bytes of an EEPROM slot."""
    framing = sum(INTEGER_TYPES[name].size for name in SLOT_HEADER + SLOT_TRAILER)
    return framing + sum(struct_sizes[name] for name in configuration)


def _eeprom(node: Tree, structs: Mapping[str, Struct]) -> Eeprom:
    configuration = tuple(node.get("configuration", FIRST_CONFIGURATION))
    size = slot_size({name: struct.size for name, struct in structs.items()}, configuration)
    given = {**node, "prose": _prose(node), "configuration": configuration}
    return Eeprom(**{"boot_counters": 1, **given}, slot_size=size)
