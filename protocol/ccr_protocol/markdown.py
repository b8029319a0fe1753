"""Makes the reference: the template's prose with tables from the spec."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ccr_protocol import exchange
from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import SLOT_FRAMING, Field, Size, Spec

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
        "bytes": lambda fields: _size_text(Size.of(fields)),
    }
    environment.filters |= filters
    every = spec.enumerator_names("state")
    arrows: dict[tuple[str, str], list[str]] = {}
    for arrow in spec.transitions:
        arrows.setdefault((arrow.event, arrow.target), []).append(arrow.source)
    return environment.get_template("reference.md.j2").render(
        spec=spec,
        largest=spec.at(spec.protocol.max_axes),
        slot_bytes=_size_text(_slot_size(Size.of(spec.saved_fields))),
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


def _slot_parts(spec: Spec) -> Iterator[tuple[str, str, str, str]]:
    """Offset, size, name and meaning of what stands in an EEPROM slot."""
    eeprom = spec.eeprom
    sizes = {struct.name: Size.of(struct.fields) for struct in spec.structs}
    offset = Size(0, 0)
    for name, size, what in (
        ("magic", Size(2, 0), f"0x{eeprom.magic:04X}"),
        ("layout", Size(1, 0), str(eeprom.layout)),
        ("generation", Size(2, 0), "counts saves"),
        *((name, sizes[name], f"[`{name}`](#{name})") for name in eeprom.configuration),
        ("crc32", Size(4, 0), "of all before it"),
    ):
        yield _size_text(offset), _size_text(size), name, what
        offset = Size(offset.fixed + size.fixed, offset.per_axis + size.per_axis)


def _slot_size(saved: Size) -> Size:
    return Size(saved.fixed + SLOT_FRAMING, saved.per_axis)


def _size_text(size: Size) -> str:
    if not size.per_axis:
        return str(size.fixed)
    each = f"{size.per_axis} n" if size.per_axis > 1 else "n"
    return f"{size.fixed} + {each}" if size.fixed else each
