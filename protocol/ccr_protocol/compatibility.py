"""What a spec may change against the released ones.

Some things never change, so that a recorded byte stream keeps its meaning and hosts and boards of
different versions can at least identify each other. Others need a new protocol version. The rest
is free: prose, requirements, the firmware's version, new messages, enums, flag bits and
constants, and ranges that become wider. Only new optional messages and their capability bits also
keep the spec hash, so that host and board need not be updated together.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ccr_protocol.spec import (
    REFERENCE_AXES,
    Constant,
    Enumeration,
    Field,
    FlagSet,
    Framing,
    Message,
    Spec,
)

_FIRST_CONTACT = ("hello", "hello_reply")
"""Readable across all versions: the other end's version is only known after them."""


def never_allowed(old: Spec, new: Spec) -> Iterator[str]:
    """Changes that not even a new protocol version allows."""
    if new.version < old.version:
        yield f"protocol version {new.version} is below the released {old.version}"
    yield from _first_contact(old, new)
    now_by_id = {message.id: message for message in new.messages}
    for message in old.messages:
        if message.id in now_by_id:
            yield from _id_keeps_meaning(message, now_by_id[message.id])
    for enum in old.enums:
        if enum.name in new.enum_by_name:
            yield from _numbers_keep_meaning("enum", enum, new.enum_by_name[enum.name])
    flags_now = {flags.name: flags for flags in new.flag_sets}
    for flags in old.flag_sets:
        if flags.name in flags_now:
            yield from _numbers_keep_meaning("flags", flags, flags_now[flags.name])
    if old.eeprom.layout == new.eeprom.layout and not _saves_the_same(old, new):
        yield "eeprom: the saved configuration differs, eeprom.layout must be another"


def _first_contact(old: Spec, new: Spec) -> Iterator[str]:
    for name in _FIRST_CONTACT:
        message, now = old.message_by_name[name], new.message_by_name[name]
        if message.id != now.id:
            yield f"message {name}: must keep the id 0x{message.id:02X}"
        for enum in sorted({field.enum for field in message.wire_fields if field.enum}):
            known = old.enumerator_names(enum)
            for added in new.enumerator_names(enum) if enum in new.enum_by_name else ():
                if added not in known:
                    yield f"enum {enum}, {added}: older hosts could not read {name}"


def _id_keeps_meaning(old: Message, new: Message) -> Iterator[str]:
    place = f"id 0x{old.id:02X}"
    if old.name != new.name:
        yield f"{place}: was {old.name}, must not become {new.name}"
        return
    place += f" {old.name}"
    if (old.rules is None) != (new.rules is None):
        yield f"{place}: goes in the other direction"
    before, after = old.wire_fields, new.wire_fields
    if len(before) != len(after):
        yield f"{place}: has {len(after)} instead of {len(before)} fields; take a new id"
    for index, (field, now) in enumerate(zip(before, after, strict=False)):
        if not _is_kept(field, now):
            yield f"{place}, field {index} {field.name}: differs in more than its range"


def _is_kept(old: Field, new: Field) -> bool:
    """Whether a board reads the same bytes: all had two axes before the count could be theirs."""
    became_per_axis = old.given_count == REFERENCE_AXES and new.is_per_axis
    changeable = {"prose", "minimum", "maximum"} | ({"given_count"} if became_per_axis else set())
    return old.model_dump(exclude=changeable) == new.model_dump(exclude=changeable)


def _saves_the_same(old: Spec, new: Spec) -> bool:
    before, after = old.saved_fields, new.saved_fields
    return len(before) == len(after) and all(map(_is_kept, before, after))


def _numbers_keep_meaning(
    kind: str, old: Enumeration | FlagSet, new: Enumeration | FlagSet
) -> Iterator[str]:
    """Values of an enumeration, or bits of a flag set."""
    word, bit = ("value", "") if kind == "enum" else ("bit", "bit ")
    if old.type != new.type:
        yield f"{kind} {old.name}: {old.type.name} must not become {new.type.name}"
    numbers = new.numbers
    names = {number: name for name, number in numbers.items()}
    for name, number in old.numbers.items():
        place = f"{kind} {old.name}, {name} = {bit}{number}"
        if names.get(number, name) != name:
            yield f"{place}: the {word} must not be given to {names[number]}"
        if numbers.get(name, number) != number:
            yield f"{place}: must not become {bit}{numbers[name]}"


def needs_new_version(old: Spec, new: Spec) -> Iterator[str]:
    """Changes that the protocol version must tell."""
    for name in sorted(Framing.model_fields.keys() - {"prose"}):
        before, after = getattr(old.framing, name), getattr(new.framing, name)
        if before != after:
            yield f"framing, {name}: {before} has become {after}"
    constants = {constant.name: _figures(constant) for constant in new.constants}
    for constant in old.constants:
        if constants.get(constant.name) != _figures(constant):
            yield f"constant {constant.name}: has changed or gone"
    yield from _enumerators(old, new)
    for message in old.messages:
        if message.name not in new.message_by_name:
            yield f"message {message.name} is gone"
        else:
            yield from _message(message, new.message_by_name[message.name])
    if set(old.transitions) != set(new.transitions):
        yield "state machine: a transition has changed"
    if _addresses(old) != _addresses(new):
        yield "eeprom: the layout has changed"


def _figures(constant: Constant) -> dict[str, Any]:
    return constant.model_dump(exclude={"prose"})


def _enumerators(old: Spec, new: Spec) -> Iterator[str]:
    """Receivers are strict: a value that they do not know spoils the whole message."""
    for kind, before, after in (
        ("enum", old.enums, new.enums),
        ("flags", old.flag_sets, new.flag_sets),
    ):
        now = {one.name: one.numbers for one in after}
        for one in before:
            numbers = now.get(one.name, {})
            for name in sorted(one.numbers.keys() - numbers):
                yield f"{kind} {one.name}, {name}: is gone"
            for name in sorted(numbers.keys() - one.numbers) if kind == "enum" else ():
                yield f"{kind} {one.name}, {name}: is new"


def _message(old: Message, new: Message) -> Iterator[str]:
    place = f"message {old.name}"
    if old.id != new.id:
        yield f"{place}: its id has become 0x{new.id:02X}"
    if old.optional != new.optional:
        yield f"{place}: must stay {f'optional ({old.optional})' if old.optional else 'mandatory'}"
    if old.rules != new.rules:
        yield f"{place}: reply, retry, session or states have changed"
    for field, now in zip(old.wire_fields, new.wire_fields, strict=False):
        if now.lower > field.lower or now.upper < field.upper:
            yield f"{place}, {field.name}: {now.lower} to {now.upper} is narrower than before"
    rules_before = old.struct.consistency if old.struct else ()
    rules_after = new.struct.consistency if new.struct else ()
    if set(rules_before) != set(rules_after):
        yield f"{place}: its consistency rule has changed"


def _addresses(spec: Spec) -> dict[str, Any]:
    eeprom = spec.eeprom
    sizes = eeprom.model_dump(exclude={"prose", "configuration"})
    return sizes | {"slot_size": eeprom.slot_size}
