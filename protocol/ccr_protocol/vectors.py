"""The golden vectors: every case with all that a receiver must make of it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from ccr_protocol.cases import Case, all_cases, cases_of_axes
from ccr_protocol.codec import Frame, Value, decode_stream, elements, encode_frame, unpack
from ccr_protocol.consistency import Clause, Comparison
from ccr_protocol.spec import REFERENCE_AXES, Field, Message, Size, Spec, Struct

_NOTE = (
    "Generated from protocol/spec.toml: do not edit. "
    "vectors: a receiver that stands between frames is fed the stream and must report the outcomes "
    "in this order. A frame also tells its wire bytes (encoded) and what its payload is (reading): "
    "a message, with its fields and the first field out of range and inconsistent axis or null; "
    "unknown_id; bad_length; or undefined_value, where an enum does not have the value. "
    "axes: number of axes of the board that the vector is for, on which lengths depend. "
    "requests: the rules of each request; its payload has size + axes * axis_size bytes; "
    "optional: the capability of the boards that know it, or null if all do. "
    "transitions: state, event and the state after it, for every pair."
)


_OTHER_AXES = (1, 4, 6, 12)


class CaseError(Exception):
    """A case does not provoke what it was made for."""


def generate(spec: Spec) -> str:
    """Text of `vectors.json`, one vector a line.

    Raises:
        CaseError: a case does not provoke what it was made for.
    """
    board = spec.at(REFERENCE_AXES)
    vectors = [_vector(case, board) for case in all_cases(spec)]
    for axes in _OTHER_AXES:
        board = spec.at(axes)
        vectors += [_vector(case, board) for case in cases_of_axes(board, axes)]
    head = {
        "note": _NOTE,
        "protocol_version": spec.version,
        "spec_hash": f"0x{spec.hash:08X}",
    }
    parts = [f'"{key}": {json.dumps(value)}' for key, value in head.items()]
    parts.append(_lines("requests", _requests(spec)))
    parts.append(_lines("transitions", _transition_table(spec)))
    parts.append(_lines("vectors", vectors))
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _lines(key: str, rows: Iterable[object]) -> str:
    return f'"{key}": [\n' + ",\n".join(json.dumps(row) for row in rows) + "\n]"


def _requests(spec: Spec) -> Iterator[dict[str, Any]]:
    for message in spec.messages:
        if message.rules:
            yield {
                "name": message.name,
                "id": message.id,
                "optional": message.optional,
                "reply_id": spec.message_by_name[message.rules.reply].id,
                "size": Size.of(message.wire_fields).fixed,
                "axis_size": Size.of(message.wire_fields).per_axis,
                "retry": message.rules.retry,
                "session": message.rules.session,
                "states": message.rules.states,
            }


def _transition_table(spec: Spec) -> list[list[str]]:
    table = {(t.source, t.event): t.target for t in spec.transitions}
    return [
        [state, event, table.get((state, event), state)]
        for state in spec.enumerator_names("state")
        for event in spec.enumerator_names("event")
    ]


def _vector(case: Case, spec: Spec) -> dict[str, Any]:
    found = list(decode_stream(case.stream, spec.framing))
    frames = tuple(outcome for outcome in found if isinstance(outcome, Frame))
    errors = tuple(outcome for outcome in found if isinstance(outcome, str))
    if frames != case.frames or case.errors not in {None, errors}:
        raise CaseError(f"{case.name}: comes out as {found}")
    return {
        "name": case.name,
        "axes": spec.axes,
        "stream": case.stream.hex(),
        "outcomes": [_outcome(outcome, spec) for outcome in found],
    }


def _outcome(outcome: Frame | str, spec: Spec) -> dict[str, Any]:
    if isinstance(outcome, str):
        return {"kind": outcome}
    return {
        "kind": "frame",
        "id": outcome.id,
        "sequence": outcome.sequence,
        "payload": outcome.payload.hex(),
        "encoded": encode_frame(outcome).hex(),
        **_reading(outcome, spec),
    }


def _reading(frame: Frame, spec: Spec) -> dict[str, Any]:
    message = next((m for m in spec.messages if m.id == frame.id), None)
    if message is None:
        return {"reading": "unknown_id"}
    if len(frame.payload) != message.size:
        return {"reading": "bad_length"}
    values = unpack(message.wire_fields, frame.payload)
    if any(_undefined(field, values[field.name], spec) for field in message.wire_fields):
        return {"reading": "undefined_value"}
    return {
        "reading": message.name,
        "fields": _nested(message, values),
        "first_out_of_range": _first_out_of_range(message.wire_fields, values),
        "inconsistent_axis": _inconsistent_axis(message.struct, values),
    }


def _undefined(field: Field, value: Value, spec: Spec) -> bool:
    if field.enum is None:
        return False
    return value not in [one.value for one in spec.enum_by_name[field.enum].values]


def _nested(message: Message, values: Mapping[str, Value]) -> dict[str, Any]:
    fields: dict[str, Any] = {field.name: values[field.name] for field in message.fields}
    if message.struct:
        fields[message.struct.attribute] = {
            field.name: values[field.name] for field in message.struct.fields
        }
    return fields


def _first_out_of_range(fields: Sequence[Field], values: Mapping[str, Value]) -> int | None:
    for index, field in enumerate(fields):
        if not all(field.lower <= number <= field.upper for number in elements(values[field.name])):
            return index
    return None


def _inconsistent_axis(struct: Struct | None, values: Mapping[str, Value]) -> int | None:
    clauses = struct.consistency if struct else ()
    bad = [axis for clause in clauses for axis in _violations(clause, values)]
    return min(bad, default=None)


def _violations(clause: Clause, values: Mapping[str, Value]) -> list[int]:
    if isinstance(clause, Comparison):
        pairs = zip(elements(values[clause.left]), elements(values[clause.right]), strict=True)
        strict = clause.operator == "<"
        return [axis for axis, (a, b) in enumerate(pairs) if a > b or (strict and a == b)]
    numbers = elements(values[clause.field])
    return [axis for axis, number in enumerate(numbers) if clause.first <= number <= clause.last]
