"""What the parts of a spec must be to each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import TypeVar

from ccr_protocol.spec import (
    ANY_STATE,
    CAPABILITIES,
    REPLY_BIT,
    Enumeration,
    Field,
    FlagSet,
    Message,
    Report,
    Request,
    Spec,
    Struct,
    Transition,
)

_GENERATED_CLASSES = frozenset({"field", "message", "payload", "request", "retry"})
_LATCHED_STATES = frozenset({"fault", "stopped"})
_EVENTS_OUT_OF_LATCHED_STATES = frozenset({"clear_requested", "stop_requested"})
_BOOT_COUNTER_SIZE = 2

T = TypeVar("T")


def problems(spec: Spec) -> Iterator[str]:
    """One line for each contradiction."""
    yield from _names(spec)
    yield from _enumerations(spec)
    yield from _flag_sets(spec)
    for struct in spec.structs:
        yield from _struct(struct, spec)
    yield from _messages(spec)
    yield from _unused(spec)
    yield from _state_machine(spec)
    yield from _sizes(spec)


def _repeated(values: Iterable[T]) -> list[T]:
    return [value for value, times in Counter(values).items() if times > 1]


def _names(spec: Spec) -> Iterator[str]:
    for name in _repeated(constant.name for constant in spec.constants):
        yield f"constant {name}: name given twice"
    named = (*spec.enums, *spec.flag_sets, *spec.structs, *spec.messages)
    names = [one.name for one in named]
    for name in _repeated(names):
        yield f"{name}: two of enum, flags, struct and message have this name"
    for name in sorted(_GENERATED_CLASSES.intersection(names)):
        yield f"{name}: the generated code uses this name itself"
    for number in _repeated(requirement.id for requirement in spec.requirements):
        yield f"requirement {number}: id given twice"


def _enumerations(spec: Spec) -> Iterator[str]:
    for enum in spec.enums:
        place = f"enum {enum.name}"
        for name in _repeated(value.name for value in enum.values):
            yield f"{place}, {name}: name given twice"
        for number in _repeated(value.value for value in enum.values):
            yield f"{place}: value {number} given twice"
        for value in enum.values:
            if not enum.type.holds(value.value):
                yield f"{place}, {value.name}: {value.value} does not fit {enum.type.name}"


def _flag_sets(spec: Spec) -> Iterator[str]:
    for flags in spec.flag_sets:
        place = f"flags {flags.name}"
        for name in _repeated(bit.name for bit in flags.bits):
            yield f"{place}, {name}: name given twice"
        for number in _repeated(bit.bit for bit in flags.bits):
            yield f"{place}: bit {number} given twice"
        for bit in flags.bits:
            if bit.bit >= 8 * flags.type.size:
                yield f"{place}, {bit.name}: {flags.type.name} has no bit {bit.bit}"


def _fields(fields: Iterable[Field], place: str, spec: Spec) -> Iterator[str]:
    for field in fields:
        where = f"{place}, field {field.name}"
        for key, limit in (("min", field.minimum), ("max", field.maximum)):
            if limit is not None and not field.type.holds(limit):
                yield f"{where}: {key} {limit} does not fit {field.type.name}"
        if field.lower > field.upper:
            yield f"{where}: min is above max"
        given = field.model_fields_set
        if ("unit" in given) != ("scale" in given):
            yield f"{where}: unit and scale come together"
        if field.enum and field.flags:
            yield f"{where}: either enum or flags"
        if field.enum or field.flags:
            if {"unit", "scale", "minimum", "maximum", "given_count"} & given:
                yield f"{where}: an enum or flags field has no unit, range or count"
            yield from _named_type(field, where, spec)


def _named_type(field: Field, where: str, spec: Spec) -> Iterator[str]:
    for kind, name, known in (
        ("enum", field.enum, spec.enums),
        ("flags", field.flags, spec.flag_sets),
    ):
        found = next((one for one in known if one.name == name), None)
        if name and found is None:
            yield f"{where}: there is no {kind} {name}"
        elif found is not None and getattr(found, "internal", False):
            yield f"{where}: {kind} {name} is internal"
        elif found is not None and found.type != field.type:
            yield f"{where}: {kind} {name} is {found.type.name}, not {field.type.name}"


def _repeated_fields(fields: Iterable[Field], place: str) -> Iterator[str]:
    for name in _repeated(field.name for field in fields):
        yield f"{place}, field {name}: name given twice"


def _struct(struct: Struct, spec: Spec) -> Iterator[str]:
    place = f"struct {struct.name}"
    yield from _fields(struct.fields, place, spec)
    yield from _repeated_fields(struct.fields, place)
    counts = {field.name: field.count for field in struct.fields}
    mentioned = {name for clause in struct.consistency for name in clause.fields}
    if unknown := sorted(mentioned - counts.keys()):
        yield f"{place}, consistent: there is no field {', '.join(unknown)}"
    elif mentioned and (1 in (axes := {counts[name] for name in mentioned}) or len(axes) > 1):
        yield f"{place}, consistent: its fields must have one element for each axis"


def _messages(spec: Spec) -> Iterator[str]:
    for number in _repeated(message.id for message in spec.messages):
        yield f"message id 0x{number:02X}: given twice"
    for message in spec.messages:
        yield from _payload(message, spec)
        yield from _optional(message, spec)
        if isinstance(message, Request):
            yield from _request(message, spec)
    for required in ("hello", "hello_reply", "ack", "nack"):
        if required not in spec.message_by_name:
            yield f"message {required}: missing"


def _payload(message: Message, spec: Spec) -> Iterator[str]:
    place = f"message {message.name}"
    yield from _fields(message.fields, place, spec)
    if message.struct_name and message.struct is None:
        yield f"{place}: there is no struct {message.struct_name}"
    yield from _repeated_fields(message.wire_fields, place)


def _optional(message: Message, spec: Spec) -> Iterator[str]:
    """A host that knows only what is mandatory must not meet anything else."""
    known = {bit.name for one in spec.flag_sets if one.name == CAPABILITIES for bit in one.bits}
    place = f"message {message.name}"
    if message.optional and message.optional not in known:
        yield f"{place}, optional: there is no capability {message.optional}"
    reply = spec.message_by_name.get(message.rules.reply) if message.rules else None
    if reply and reply.optional not in (None, message.optional):
        yield f"{place}, reply: {reply.name} needs the capability {reply.optional}"


def _request(request: Request, spec: Spec) -> Iterator[str]:
    place = f"message {request.name}"
    reply = spec.message_by_name.get(request.reply)
    if reply is None:
        yield f"{place}, reply: there is no message {request.reply}"
    elif not isinstance(reply, Report):
        yield f"{place}, reply: {reply.name} does not go to the host"
    elif reply.name != "ack" and reply.id != request.id + REPLY_BIT:
        yield f"{place}, reply: {reply.name} must have the id 0x{request.id + REPLY_BIT:02X}"
    first = [(field.name, field.type.name) for field in request.fields[:1]]
    begins_with_session = [name for name, _ in first] == ["session"]
    if request.session and first != [("session", "u16")]:
        yield f"{place}, session: its first field must be session, u16"
    if not request.session and begins_with_session:
        yield f"{place}, session: begins with a session that is not checked"
    if request.states != ANY_STATE:
        for state in sorted({*request.states} - {*spec.enumerator_names("state")}):
            yield f"{place}, states: there is no state {state}"
    for state in _repeated(request.states):
        yield f"{place}, states: {state} given twice"


def _unused(spec: Spec) -> Iterator[str]:
    """What only optional messages use counts as unused: the hash would depend on them."""
    mandatory = [message for message in spec.messages if not message.optional]
    fields = [field for one in (*spec.structs, *mandatory) for field in one.fields]
    enums = {field.enum for field in fields}
    # Bits of the detail of a nack; no field can carry them by type.
    flags = {field.flags for field in fields} | {"config_groups"}
    structs = {message.struct_name for message in mandatory}
    kinds: tuple[tuple[str, Iterable[Enumeration | FlagSet | Struct], set[str | None]], ...] = (
        ("enum", (enum for enum in spec.enums if not enum.internal), enums),
        ("flags", spec.flag_sets, flags),
        ("struct", spec.structs, structs),
    )
    for kind, defined, used in kinds:
        for name in (one.name for one in defined if one.name not in used):
            yield f"{kind} {name}: no mandatory message uses it"


def _state_machine(spec: Spec) -> Iterator[str]:
    states, events = ({*spec.enumerator_names(enum)} for enum in ("state", "event"))
    place = "state_machine"
    for required in sorted({"boot", "fault", "stopped"} - states):
        yield f"enum state: there must be a state {required}"
        return
    arrows = spec.transitions
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


def _reachable(start: str, arrows: Iterable[Transition]) -> set[str]:
    reached = {start}
    while more := {to for source, _, to in arrows if source in reached} - reached:
        reached |= more
    return reached


def _sizes(spec: Spec) -> Iterator[str]:
    """What is too long on a small board, or else on the largest one."""
    if spec.protocol.max_axes < spec.protocol.small_axes:
        yield "protocol: max_axes is below small_axes"
        return
    for axes in (spec.protocol.small_axes, spec.protocol.max_axes):
        board = spec.at(axes)
        limit = board.framing.max_payload
        found = [
            f"message {message.name}: {message.size} bytes are more than max_payload {limit}"
            for message in board.messages
            if message.size > limit
        ]
        found += _eeprom(board)
        if found:
            yield from found
            return


def _eeprom(spec: Spec) -> Iterator[str]:
    eeprom = spec.eeprom
    known = {struct.name for struct in spec.structs}
    if missing := [name for name in eeprom.configuration if name not in known]:
        yield f"eeprom: the configuration needs the struct {', '.join(missing)}"
        return
    counters = _BOOT_COUNTER_SIZE * eeprom.boot_counters
    areas = sorted(
        [
            (eeprom.slot_a, eeprom.slot_size, "slot_a"),
            (eeprom.slot_b, eeprom.slot_size, "slot_b"),
            (eeprom.boot_counter, counters, "boot_counter"),
        ]
    )
    for (start, size, name), (after, _, next_name) in pairwise(areas):
        if start + size > after:
            yield f"eeprom: {name} ({size} bytes) reaches into {next_name}"
    start, size, name = areas[-1]
    if start + size > eeprom.size:
        yield f"eeprom: {name} ends beyond the {eeprom.size} bytes there are"
