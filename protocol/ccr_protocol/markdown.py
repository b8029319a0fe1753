"""Makes the reference: the template's prose with tables from the spec."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ccr_protocol import exchange
from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import Field, Spec

_NOT_DRAWN = ("stop_requested", "fault_raised")
"""Events that lead from nearly every state to the same one."""


def generate(spec: Spec) -> str:
    """Text of `reference.md`."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    filters: dict[str, Callable[..., str]] = {
        "cell": lambda text: str(text).replace("|", "\\|"),
        "code": _code_list,
        "states": lambda states: _states_text(states, spec),
        "range": _range_text,
        "clause": _clause_text,
    }
    environment.filters |= filters
    every = spec.enumerator_names("state")
    arrows: dict[tuple[str, str], list[str]] = {}
    for arrow in spec.transitions:
        arrows.setdefault((arrow.event, arrow.target), []).append(arrow.source)
    return environment.get_template("reference.md.j2").render(
        spec=spec,
        events={value.name: value.prose for value in spec.enum_by_name["event"].values},
        arrows=arrows,
        not_drawn={
            event: (to, [state for state in every if state not in sources])
            for wanted in _NOT_DRAWN
            for (event, to), sources in arrows.items()
            if event == wanted
        },
        slot_parts=list(_slot_parts(spec)),
        session=f"{exchange.SESSION:04X}",
        exchange=exchange.generate(spec),
    )


def _code_list(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _states_text(states: Sequence[str], spec: Spec) -> str:
    every = spec.enumerator_names("state")
    missing = [state for state in every if state not in states]
    if not missing:
        return "every state"
    if len(missing) < len(states):
        return f"all but {_code_list(missing)}"
    return _code_list(states)


def _range_text(field: Field) -> str:
    if kind := field.enum or field.flags:
        return f"[`{kind}`](#{kind})"
    if field.minimum is None and field.maximum is None:
        return ""
    return f"{field.lower} to {field.upper}"


def _clause_text(clause: Clause) -> str:
    if isinstance(clause, Comparison):
        return f"`{clause.left} {clause.operator} {clause.right}`"
    return f"`{clause.field}` is not from {clause.first} to {clause.last}"


def _slot_parts(spec: Spec) -> Iterator[tuple[int, int, str, str]]:
    """Offset, size, name and meaning of what stands in an EEPROM slot."""
    eeprom = spec.eeprom
    sizes = {struct.name: struct.size for struct in spec.structs}
    offset = 0
    for name, size, what in (
        ("magic", 2, f"0x{eeprom.magic:04X}"),
        ("layout", 1, str(eeprom.layout)),
        ("generation", 2, "counts saves"),
        *((name, sizes[name], f"[`{name}`](#{name})") for name in eeprom.configuration),
        ("crc32", 4, "of all before it"),
    ):
        yield offset, size, name, what
        offset += size
