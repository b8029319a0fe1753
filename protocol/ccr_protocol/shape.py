"""The shape of `spec.toml`: which keys stand where, and what kind of value each takes.

A check takes a value and its place and appends one line to the problems for each defect. What
the values mean together is checked in `meaning`.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from ccr_protocol.spec import INTEGER_TYPES

Problems: TypeAlias = list[str]
Check: TypeAlias = Callable[[Any, str, Problems], None]

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_REQUIREMENT_ID = re.compile(r"[A-Z]{3}-[1-9][0-9]*")
_PROSE = re.compile(r"[^\"\\]*")
_PROSE_HINT = 'printable ASCII without " and \\, which would end a comment or string'

_CPP_KEYWORDS = frozenset(
    {
        "auto",
        "bool",
        "case",
        "char",
        "const",
        "default",
        "delete",
        "do",
        "double",
        "enum",
        "explicit",
        "extern",
        "float",
        "friend",
        "goto",
        "inline",
        "int",
        "long",
        "mutable",
        "namespace",
        "new",
        "operator",
        "private",
        "protected",
        "public",
        "register",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "template",
        "this",
        "throw",
        "typedef",
        "union",
        "unsigned",
        "using",
        "virtual",
        "void",
        "volatile",
    }
)
_PAYLOAD_MEMBERS = frozenset({"pack", "unpack", "first_out_of_range", "inconsistent_axis"})


def name(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    """Accept a snake_case name that is free in both languages."""
    if not isinstance(value, str) or not _NAME.fullmatch(value):
        problems.append(f"{place}: {value!r} is no snake_case name")
    elif keyword.iskeyword(value) or value in _CPP_KEYWORDS | _PAYLOAD_MEMBERS:
        problems.append(f"{place}: the name {value!r} is taken by Python, C++ or the generator")


def prose(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    """Accept text that may stand in comments and strings of both languages."""
    if not isinstance(value, str) or not value.strip():
        problems.append(f"{place}: must be a text that is not empty")
        return
    words = " ".join(value.split())
    if not (words.isascii() and words.isprintable() and _PROSE.fullmatch(words)):
        problems.append(f"{place}: must be {_PROSE_HINT}")


def requirement_id(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    """Accept e.g. FRM-1."""
    if not isinstance(value, str) or not _REQUIREMENT_ID.fullmatch(value):
        problems.append(f"{place}: {value!r} is not like FRM-1")


def boolean(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    """Accept true and false."""
    if not isinstance(value, bool):
        problems.append(f"{place}: must be true or false, not {value!r}")


def integer(minimum: int, maximum: int) -> Check:
    """Accept an integer in a range."""

    def check(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
        if isinstance(value, bool) or not isinstance(value, int):
            problems.append(f"{place}: must be an integer, not {value!r}")
        elif not minimum <= value <= maximum:
            problems.append(f"{place}: {value} is not from {minimum} to {maximum}")

    return check


def positive_number(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    """Accept an integer or a float above 0."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        problems.append(f"{place}: must be a number above 0, not {value!r}")


def choice(*allowed: Any) -> Check:  # noqa: ANN401
    """Accept one of a few values."""

    def check(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
        if not any(type(value) is type(one) and value == one for one in allowed):
            known = ", ".join(repr(one) for one in allowed)
            problems.append(f"{place}: {value!r} is not one of {known}")

    return check


def list_of(check_item: Check, *, least: int = 1, exactly: int | None = None) -> Check:
    """Accept a list; its tables are named in messages by their `name`, `id` or number."""

    def check(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
        if not isinstance(value, list):
            problems.append(f"{place}: must be a list")
            return
        if exactly is not None and len(value) != exactly:
            problems.append(f"{place}: must have {exactly} entries, not {len(value)}")
        if len(value) < least:
            problems.append(f"{place}: must not be empty")
        for index, item in enumerate(value):
            check_item(item, f"{place} {label(item, index)}", problems)

    return check


def label(item: Any, index: int) -> str:  # noqa: ANN401
    """How a message calls an entry of a list."""
    if isinstance(item, Mapping):
        for key in ("name", "id"):
            if isinstance(item.get(key), str):
                return str(item[key])
    return f"#{index + 1}"


def table(required: Mapping[str, Check], optional: Mapping[str, Check] | None = None) -> Check:
    """Accept a table with these keys and no others."""
    known = {**required, **(optional or {})}

    def check(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
        if not isinstance(value, Mapping):
            problems.append(f"{place}: must be a table")
            return
        where = f"{place}, " if place else ""
        for key in value:
            if key not in known:
                problems.append(f"{where}{key}: unknown key; known: {', '.join(sorted(known))}")
        for key, check_value in known.items():
            if key in value:
                check_value(value[key], f"{where}{key}", problems)
            elif key in required:
                problems.append(f"{where}{key}: missing")

    return check


def _any_or_states(value: Any, place: str, problems: Problems) -> None:  # noqa: ANN401
    if value != "any":
        list_of(name)(value, place, problems)


_U32_MAX = (1 << 32) - 1
_I32 = (-(1 << 31), _U32_MAX)

_FIELD = table(
    {"name": name, "type": choice(*INTEGER_TYPES), "prose": prose},
    {
        "count": integer(2, 16),
        "unit": prose,
        "scale": positive_number,
        "min": integer(*_I32),
        "max": integer(*_I32),
        "enum": name,
        "flags": name,
    },
)

_NAMED_VALUE = table({"name": name, "value": integer(*_I32), "prose": prose})
_NAMED_BIT = table({"name": name, "bit": integer(0, 31), "prose": prose})
_UNSIGNED = choice(*(n for n, t in INTEGER_TYPES.items() if not t.signed))

SPEC = table(
    {
        "protocol": table(
            {
                "name": name,
                "version": integer(1, 255),
                "firmware_version": list_of(integer(0, 255), exactly=3),
                "prose": prose,
            }
        ),
        "framing": table(
            {
                "baud": integer(1, _U32_MAX),
                "baud_fallback": integer(1, _U32_MAX),
                "encoding": choice("COBS"),
                "delimiter": choice(0),
                "crc": choice("CRC-16/X-25"),
                # With id, sequence and CRC below 254 bytes, so that COBS adds exactly one.
                "max_payload": integer(1, 249),
                "prose": prose,
            }
        ),
        "constant": list_of(
            table({"name": name, "value": integer(*_I32), "unit": prose, "prose": prose})
        ),
        "enum": list_of(
            table(
                {"name": name, "type": _UNSIGNED, "prose": prose, "values": list_of(_NAMED_VALUE)},
                {"internal": boolean},
            )
        ),
        "flags": list_of(
            table({"name": name, "type": _UNSIGNED, "prose": prose, "bits": list_of(_NAMED_BIT)})
        ),
        "struct": list_of(
            table({"name": name, "prose": prose, "fields": list_of(_FIELD)}, {"consistent": prose})
        ),
        "message": list_of(
            table(
                {
                    "id": integer(0, 255),
                    "name": name,
                    "direction": choice("to_board", "to_host"),
                    "prose": prose,
                },
                {
                    "fields": list_of(_FIELD, least=0),
                    "struct": name,
                    "reply": name,
                    "retry": choice("repeat", "once", "never"),
                    "session": boolean,
                    "states": _any_or_states,
                },
            )
        ),
        "state_machine": table(
            {
                "transitions": list_of(
                    table({"from": list_of(name), "event": name, "to": name}),
                )
            }
        ),
        "eeprom": table(
            {
                "prose": prose,
                "size": integer(1, 65536),
                "slot_a": integer(0, 65535),
                "slot_b": integer(0, 65535),
                "boot_counter": integer(0, 65535),
                "magic": integer(0, 65535),
                "layout": integer(0, 255),
            },
            {"boot_counters": integer(1, 255), "configuration": list_of(name)},
        ),
        "requirement": list_of(table({"id": requirement_id, "text": prose})),
    }
)
