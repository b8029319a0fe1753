"""Makes the reference: the template's prose with tables from the spec."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ccr_protocol import exchange
from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import Field, Message, Spec, Struct

_TEMPLATE = Path(__file__).with_name("reference_template.md")
_PLACEHOLDER = re.compile(r"\{\{(\w+)\}\}")
_NOT_DRAWN = ("stop_requested", "fault_raised")
"""Events that lead from nearly every state to the same one."""


def generate(spec: Spec) -> str:
    """Text of `reference.md`."""
    parts = _parts(spec)
    return _PLACEHOLDER.sub(lambda found: parts[found[1]], _TEMPLATE.read_text(encoding="utf-8"))


def _parts(spec: Spec) -> dict[str, str]:
    framing = spec.framing
    return {
        "version": str(spec.version),
        "spec_hash": f"0x{spec.hash:08X}",
        "firmware_version": ".".join(map(str, spec.firmware_version)),
        "prose": spec.prose,
        "framing_table": _framing_table(spec),
        "framing_prose": framing.prose,
        "max_payload": str(framing.max_payload),
        "max_encoded": str(framing.max_encoded),
        "baud": str(framing.baud),
        "baud_fallback": str(framing.baud_fallback),
        "nack_table": _nack_table(spec),
        "message_table": _message_table(spec),
        "messages": "\n\n".join(_message(message, spec) for message in spec.messages),
        "structs": "\n\n".join(_struct(struct) for struct in spec.structs),
        "enums": "\n\n".join([*_enumerations(spec), *_flag_sets(spec)]),
        "diagram": _diagram(spec),
        "not_drawn": _not_drawn(spec),
        "transition_rows": _transition_rows(spec),
        "constant_table": _constant_table(spec),
        "eeprom_prose": spec.eeprom.prose,
        "eeprom_table": _eeprom_table(spec),
        "slot_table": _slot_table(spec),
        "session": f"{exchange.SESSION:04X}",
        "exchange": exchange.generate(spec),
        "requirement_rows": "\n".join(f"| {r.id} | {_cell(r.text)} |" for r in spec.requirements),
    }


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _code_list(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _framing_table(spec: Spec) -> str:
    framing = spec.framing
    return _table(
        ["", ""],
        [
            ["baud rate", f"{framing.baud}, {framing.baud_fallback} as a fallback; 8N1"],
            ["encoding", framing.encoding],
            ["delimiter", f"0x{framing.delimiter:02X}"],
            ["check", framing.crc],
            ["longest payload", f"{framing.max_payload} bytes"],
        ],
    )


def _nack_table(spec: Spec) -> str:
    values = spec.enum_by_name["nack_code"].values
    return _table(
        ["code", "name", "refused because"],
        ([str(value.value), f"`{value.name}`", _cell(value.prose)] for value in values),
    )


def _message_table(spec: Spec) -> str:
    header = ["id", "message", "bytes", "answer", "retry", "session", "allowed in"]
    return _table(header, (_message_row(message, spec) for message in spec.messages))


def _message_row(message: Message, spec: Spec) -> list[str]:
    row = [f"0x{message.id:02X}", f"[`{message.name}`](#{message.name})", str(message.size)]
    rules = message.rules
    if rules is None:
        return [*row, "", "", "", ""]
    session = "yes" if rules.session else "no"
    return [*row, f"`{rules.reply}`", rules.retry, session, _states_text(rules.states, spec)]


def _states_text(states: Sequence[str], spec: Spec) -> str:
    every = spec.enumerator_names("state")
    missing = [state for state in every if state not in states]
    if not missing:
        return "every state"
    if len(missing) < len(states):
        return f"all but {_code_list(missing)}"
    return _code_list(states)


def _message(message: Message, spec: Spec) -> str:
    lines = [f"### `{message.name}`", "", message.prose]
    rules = message.rules
    if rules:
        needs = "needs the session" if rules.session else "needs no session"
        allowed = _states_text(rules.states, spec)
        lines += [
            "",
            f"Id 0x{message.id:02X}, to the board; answered by `{rules.reply}`; "
            f"retry: {rules.retry}; {needs}; allowed in {allowed}.",
        ]
    else:
        lines += ["", f"Id 0x{message.id:02X}, to the host."]
    if message.fields:
        lines += ["", _field_table(message.fields, 0)]
    if message.struct:
        name = message.struct.name
        lead = "Then the fields" if message.fields else "The fields"
        indices = f", indices from {len(message.fields)} on" if message.fields else ""
        lines += ["", f"{lead} of [`{name}`](#{name}){indices}."]
    if not message.wire_fields:
        lines += ["", "No payload."]
    return "\n".join(lines)


def _field_table(fields: Sequence[Field], first_offset: int) -> str:
    rows = []
    offset = first_offset
    for index, field in enumerate(fields):
        rows.append(
            [
                str(index),
                str(offset),
                f"`{field.name}`",
                field.type.name + (f" x {field.count}" if field.count > 1 else ""),
                field.unit_text,
                _range_text(field),
                _cell(field.prose),
            ]
        )
        offset += field.size
    return _table(["index", "offset", "field", "type", "step", "range", "meaning"], rows)


def _range_text(field: Field) -> str:
    if field.enum or field.flags:
        kind = field.enum or field.flags
        return f"[`{kind}`](#{kind})"
    if field.minimum is None and field.maximum is None:
        return ""
    return f"{field.lower} to {field.upper}"


def _struct(struct: Struct) -> str:
    lines = [f"### `{struct.name}`", "", struct.prose, "", _field_table(struct.fields, 0)]
    if struct.consistency:
        lines += ["", "On each axis, or it is `inconsistent`:", ""]
        lines += [f"- {_clause_text(clause)}" for clause in struct.consistency]
    return "\n".join(lines)


def _clause_text(clause: Clause) -> str:
    if isinstance(clause, Comparison):
        return f"`{clause.left} {clause.operator} {clause.right}`"
    return f"`{clause.field}` is not from {clause.first} to {clause.last}"


def _enumerations(spec: Spec) -> Iterator[str]:
    for enum in spec.enums:
        rows = ([str(v.value), f"`{v.name}`", _cell(v.prose)] for v in enum.values)
        table = _table(["value", "name", "meaning"], rows)
        yield f"### `{enum.name}`\n\n{enum.type.name}. {enum.prose}\n\n{table}"


def _flag_sets(spec: Spec) -> Iterator[str]:
    for flags in spec.flag_sets:
        rows = ([str(b.bit), f"`{b.name}`", _cell(b.prose)] for b in flags.bits)
        table = _table(["bit", "name", "meaning"], rows)
        yield (
            f"### `{flags.name}`\n\n{flags.type.name}. {flags.prose} "
            f"Bits without a name are sent as 0 and ignored.\n\n{table}"
        )


def _diagram(spec: Spec) -> str:
    lines = ["stateDiagram-v2", f"    [*] --> {spec.transitions[0].source}"]
    lines += [
        f"    {t.source} --> {t.target}: {t.event}"
        for t in spec.transitions
        if t.event not in _NOT_DRAWN
    ]
    return "\n".join(lines)


def _not_drawn(spec: Spec) -> str:
    every = spec.enumerator_names("state")
    sentences = []
    for event in _NOT_DRAWN:
        arrows = [t for t in spec.transitions if t.event == event]
        spared = _code_list(state for state in every if state not in {t.source for t in arrows})
        sentences.append(f"`{event}` leads to `{arrows[0].target}` from all states but {spared}")
    return f"Not drawn: {'; '.join(sentences)}."


def _transition_rows(spec: Spec) -> str:
    prose = {value.name: value.prose for value in spec.enum_by_name["event"].values}
    sources: dict[tuple[str, str], list[str]] = {}
    for transition in spec.transitions:
        sources.setdefault((transition.event, transition.target), []).append(transition.source)
    return "\n".join(
        f"| `{event}` | {_code_list(states)} | `{to}` | {_cell(prose[event])} |"
        for (event, to), states in sources.items()
    )


def _constant_table(spec: Spec) -> str:
    return _table(
        ["constant", "value", "unit", "meaning"],
        ([f"`{c.name}`", str(c.value), c.unit, _cell(c.prose)] for c in spec.constants),
    )


def _eeprom_table(spec: Spec) -> str:
    eeprom = spec.eeprom
    return _table(
        ["address", "bytes", "what"],
        [
            [str(eeprom.slot_a), str(eeprom.slot_size), "slot a"],
            [str(eeprom.slot_b), str(eeprom.slot_size), "slot b"],
            [str(eeprom.boot_counter), f"2 * {eeprom.boot_counters}", "boot counters"],
        ],
    )


def _slot_table(spec: Spec) -> str:
    eeprom = spec.eeprom
    sizes = {struct.name: struct.size for struct in spec.structs}
    parts = [
        ("magic", 2, f"0x{eeprom.magic:04X}"),
        ("layout", 1, str(eeprom.layout)),
        ("generation", 2, "counts saves"),
        *((name, sizes[name], f"[`{name}`](#{name})") for name in eeprom.configuration),
        ("crc32", 4, "of all before it"),
    ]
    rows, offset = [], 0
    for name, size, what in parts:
        rows.append([str(offset), str(size), name, what])
        offset += size
    return _table(["offset in the slot", "bytes", "part", "what"], rows)
