"""Turns the golden vectors into a C++ header for the native tests.

    python vectors_header.py vectors.json vectors.h AXES

Standard library only. Besides the vectors it writes one `flatten` for each message, so that the
decoded values are compared field by field under their names.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

_NOT_MESSAGES = frozenset({"unknown_id", "bad_length", "undefined_value"})

_NONE = -1
"""`ccr::kNone`."""


def header(document: Mapping[str, Any], axes: int) -> str:
    """Text of the header for a board with so many axes."""
    vectors = [vector for vector in document["vectors"] if vector["axes"] == axes]
    lines = ["#pragma once", "", '#include "vector_types.h"', ""]
    lines += _flatteners(vectors)
    lines += _requests(document["requests"])
    lines += _transitions(document["transitions"])
    lines.append("const Vector kVectors[] = {")
    lines += [f"    {{{', '.join(_vector(vector))}}}," for vector in vectors]
    lines.append("};")
    for index, vector in enumerate(vectors):
        lines.append(f"TEST_CASE({json.dumps('vector: ' + vector['name'])}) {{ check({index}); }}")
    return "\n".join(lines) + "\n"


def _vector(vector: Mapping[str, Any]) -> Iterator[str]:
    outcomes = "\n".join(_outcome(outcome) for outcome in vector["outcomes"])
    yield from (json.dumps(text) for text in (vector["stream"], outcomes))


def _camel(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _frames(vectors: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    for vector in vectors:
        yield from (outcome for outcome in vector["outcomes"] if outcome["kind"] == "frame")


def _flatteners(vectors: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    shapes = {frame["reading"]: frame for frame in _frames(vectors)}
    messages = {name: shapes[name] for name in shapes if name not in _NOT_MESSAGES}
    yield "namespace ccr {  // where the call by type finds them"
    for name, frame in messages.items():
        members = list(_members("m", frame["fields"]))
        parameter = "m" if members else ""
        yield f"inline Values flatten(const {_camel(name)}& {parameter}) {{"
        yield f"  return {{{', '.join(f'static_cast<int64_t>({member})' for member in members)}}};"
        yield "}"
    yield "}"
    yield "inline std::string read_message(uint8_t id, const uint8_t* payload, uint8_t size) {"
    yield "  switch (id) {"
    for name in messages:
        yield f"    case ccr::{_camel(name)}::kId:"
        yield f'      return read<ccr::{_camel(name)}>("{name}", payload, size);'
    yield "    default:"
    yield '      return "unknown_id";'
    yield "  }"
    yield "}"


def _members(owner: str, fields: Mapping[str, Any]) -> Iterator[str]:
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _members(f"{owner}.{name}", value)
        elif isinstance(value, list):
            yield from (f"{owner}.{name}[{index}]" for index in range(len(value)))
        else:
            yield f"{owner}.{name}"


def _numbers(fields: Mapping[str, Any]) -> Iterator[int]:
    for value in fields.values():
        if isinstance(value, Mapping):
            yield from _numbers(value)
        elif isinstance(value, list):
            yield from value
        else:
            yield value


def _requests(rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    yield "const Request kRequests[] = {"
    for row in rows:
        states = ", ".join(f"ccr::State::k{_camel(state)}" for state in row["states"])
        size = f"{row['size']} + {row['axis_size']} * ccr::kAxes"
        yield (
            f"    {{{{{row['id']}, {row['reply_id']}, {size}, "
            f"ccr::Retry::k{_camel(row['retry'])}, {json.dumps(row['session'])}, 0}}, "
            f"{{{states}}}}},"
        )
    yield "};"


def _transitions(rows: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    yield "const Step kSteps[] = {"
    for state, event, after in rows:
        yield (
            f"    {{ccr::State::k{_camel(state)}, ccr::Event::k{_camel(event)}, "
            f"ccr::State::k{_camel(after)}}},"
        )
    yield "};"


def _outcome(outcome: Mapping[str, Any]) -> str:
    """One line of text, as `describe` in test_protocol.cpp writes it."""
    if outcome["kind"] != "frame":
        return str(outcome["kind"])
    words = [outcome[key] for key in ("kind", "id", "sequence", "payload", "encoded", "reading")]
    if outcome["reading"] not in _NOT_MESSAGES:
        checks = [outcome["first_out_of_range"], outcome["inconsistent_axis"]]
        words += [_NONE if index is None else index for index in checks]
        words += _numbers(outcome["fields"])
    return " ".join(map(str, words))


if __name__ == "__main__":
    source, target = map(Path, sys.argv[1:3])
    document = json.loads(source.read_text(encoding="utf-8"))
    target.write_text(header(document, int(sys.argv[3])), encoding="utf-8")
