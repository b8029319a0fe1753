"""The generated Python messages, by properties over every message and every golden vector."""

import dataclasses
from enum import IntEnum
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.link import messages
from ccr_host.link.messages import MESSAGES, Message, Payload, PayloadError

STRUCTS = [messages.Limits, messages.Slew, messages.Watchdog, messages.Calibration]
ALL = [*MESSAGES.values(), *STRUCTS, messages.StateReport]

_BITS = {"b": (-(2**7), 2**7), "h": (-(2**15), 2**15), "i": (-(2**31), 2**31)}


def _type_span(code: str) -> tuple[int, int]:
    low, high = _BITS[code.lower()]
    return (0, 2 * high - 1) if code.isupper() else (low, high - 1)


def _field_values(
    field: Any, annotation: Any, axes: int, *, in_range: bool
) -> st.SearchStrategy[Any]:
    if isinstance(annotation, type) and issubclass(annotation, IntEnum):
        return st.sampled_from(list(annotation))
    lower, upper = (field.minimum, field.maximum) if in_range else _type_span(field.code)
    number = st.integers(lower, upper)
    return st.tuples(*[number] * field.count_at(axes)) if field.is_array else number


AXES = st.integers(1, messages.MAX_AXES)
few = settings(max_examples=30)
"""Examples of each message; as messages share kinds of fields, 1,400 of each property."""


def payloads(cls: type[Payload], axes: int, *, in_range: bool) -> st.SearchStrategy[Any]:
    annotations = {field.name: field.type for field in dataclasses.fields(cls)}
    values = {
        field.name: _field_values(
            field, getattr(messages, str(annotations[field.name]), None), axes, in_range=in_range
        )
        for field in cls.FIELDS
    }
    if cls.NESTED is not None:
        attribute, kind = cls.NESTED
        values[attribute] = payloads(kind, axes, in_range=in_range)
    return st.builds(cls, **values)


@pytest.mark.long
@pytest.mark.parametrize("cls", ALL)
@few
@given(data=st.data())
def test_unpacking_what_was_packed_gives_the_same_payload(cls, data) -> None:
    axes = data.draw(AXES)
    payload = data.draw(payloads(cls, axes, in_range=False))
    packed = payload.pack()
    assert len(packed) == cls.size(axes)
    assert cls.unpack(packed) == cls.unpack(packed, axes) == payload


@pytest.mark.long
@pytest.mark.parametrize("cls", ALL)
@few
@given(data=st.data())
def test_values_in_their_ranges_are_not_out_of_range(cls, data) -> None:
    assert data.draw(payloads(cls, data.draw(AXES), in_range=True)).first_out_of_range() is None


@pytest.mark.long
@pytest.mark.parametrize("cls", ALL)
@given(content=st.binary(max_size=64))
def test_any_bytes_are_unpacked_or_refused_with_a_payload_error(cls, content: bytes) -> None:
    try:
        payload = cls.unpack(content)
    except PayloadError as error:
        assert cls.NAME in error.cause or "instead of" in error.cause or " is no " in error.cause
    else:
        assert payload.pack() == content


@pytest.mark.long
@pytest.mark.parametrize("cls", ALL)
@few
@given(data=st.data())
def test_bytes_of_the_right_length_are_unpacked_or_have_an_undefined_value(cls, data) -> None:
    axes = data.draw(AXES)
    content = data.draw(st.binary(min_size=cls.size(axes), max_size=cls.size(axes)))
    try:
        assert cls.unpack(content, axes).pack() == content
    except PayloadError as error:
        assert " is no " in error.cause


@pytest.mark.parametrize("axes", [1, 2, 12])
@pytest.mark.parametrize("cls", ALL)
def test_another_length_is_refused_with_both_lengths(cls, axes: int) -> None:
    right = cls.size(axes)
    for size in (right - 1, right + 1, right + max(cls.AXIS_SIZE, 1)):
        if size >= 0:
            with pytest.raises(PayloadError, match=f"with {size} instead of {right} bytes"):
                cls.unpack(bytes(size), axes)


def _zero(cls: type[Payload]) -> Any:
    # Zero is a value of every enum but nack_code.
    content = bytearray(cls.size(2))
    if cls is messages.Nack:
        content[1] = messages.NackCode.UNKNOWN_ID
    return cls.unpack(bytes(content))


@pytest.mark.parametrize("cls", ALL)
def test_a_value_that_does_not_fit_is_refused_by_message_and_field(cls) -> None:
    zero = _zero(cls)
    for field in cls.FIELDS:
        low, high = _type_span(field.code)
        for bad in (low - 1, high + 1):
            count = field.count_at(2)
            value = (0,) * (count - 1) + (bad,) if field.is_array else bad
            with pytest.raises(PayloadError) as refusal:
                dataclasses.replace(zero, **{field.name: value}).pack()
            assert f"{cls.NAME}.{field.name} = " in refusal.value.cause
            assert f"from {low} to {high}" in refusal.value.cure


@pytest.mark.parametrize("bad", [1.5, "1", None, (), (1.5,), (0,) * 17])
def test_a_value_of_another_type_is_refused_too(bad: Any) -> None:
    target = messages.SetTarget(1, bad, 0, 20)
    with pytest.raises(PayloadError, match=r"set_target\.target_cdeg"):
        target.pack()


def test_arrays_of_wrong_lengths_are_refused_even_where_their_sum_is_right() -> None:
    limits = messages.Limits((1, 2), (3, 4, 5), (6,))
    with pytest.raises(PayloadError, match=r"limits\.angle_max_cdeg"):
        limits.pack()


def test_the_index_of_a_field_counts_on_into_the_struct() -> None:
    limits = messages.Limits((-8500, -8500), (8500, 13501), (0, 0))
    assert limits.first_out_of_range() == 1
    assert messages.SetLimits(session=7, limits=limits).first_out_of_range() == 2


def test_the_first_of_several_fields_out_of_range_is_reported() -> None:
    assert messages.SetTarget(1, (0, 18001), 10001, 19).first_out_of_range() == 1
    assert messages.SetTarget(1, (0, 18000), 10001, 19).first_out_of_range() == 2
    assert messages.SetTarget(1, (0, 18000), 10000, 19).first_out_of_range() == 3
    assert messages.SetTarget(1, (0, 18000), 10000, 20).first_out_of_range() is None


def test_the_first_inconsistent_axis_is_reported_through_the_message() -> None:
    good = messages.Limits((-10, -10), (10, 10), (10, -10))
    assert messages.SetLimits(1, good).inconsistent_axis() is None
    bad = messages.Limits((-10, -10), (10, -10), (0, -10))
    assert messages.SetLimits(1, bad).inconsistent_axis() == 1
    assert messages.SetSlew(1, messages.Slew((1, 1))).inconsistent_axis() is None


def test_a_message_knows_how_the_board_treats_it() -> None:
    arm = messages.REQUESTS[messages.Arm.ID]
    assert (arm.REPLY_ID, arm.RETRY, arm.NEEDS_SESSION) == (messages.Ack.ID, "once", True)
    assert {messages.State.DISARMED} == arm.ALLOWED_STATES
    assert set(messages.State) == messages.Stop.ALLOWED_STATES


def test_requests_have_the_rules_of_the_vectors(vector_document) -> None:
    rules = {
        row["id"]: (
            *(row["name"], row["reply_id"], row["size"], row["axis_size"]),
            *(row["retry"], row["session"]),
            messages.Capabilities[row["optional"].upper()] if row["optional"] else 0,
        )
        for row in vector_document["requests"]
    }
    assert rules == {
        request.ID: (
            request.NAME,
            request.REPLY_ID,
            request.SIZE,
            request.AXIS_SIZE,
            request.RETRY,
            request.NEEDS_SESSION,
            request.CAPABILITY,
        )
        for request in messages.REQUESTS.values()
    }
    for row in vector_document["requests"]:
        states = {messages.State[name.upper()] for name in row["states"]}
        assert states == messages.REQUESTS[row["id"]].ALLOWED_STATES


def test_every_reply_exists_and_only_requests_are_requests() -> None:
    assert {request.REPLY_ID for request in messages.REQUESTS.values()} <= MESSAGES.keys()
    assert messages.Ack.ID not in messages.REQUESTS
    for number, message in MESSAGES.items():
        assert number == message.ID
        assert issubclass(message, Message)


def _nested_fields(payload: Payload) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for field in dataclasses.fields(payload):  # type: ignore[arg-type]
        value = getattr(payload, field.name)
        if isinstance(value, Payload):
            result[field.name] = _nested_fields(value)
        else:
            result[field.name] = list(value) if isinstance(value, tuple) else int(value)
    return result


def test_every_golden_vector_reads_as_it_should(vectors) -> None:
    frames = [(o, v["axes"]) for v in vectors for o in v["outcomes"] if o["kind"] == "frame"]
    for frame, axes in frames:
        assert _reading(frame["id"], bytes.fromhex(frame["payload"]), axes) == {
            key: frame[key]
            for key in ("reading", "fields", "first_out_of_range", "inconsistent_axis")
            if key in frame
        }
    assert len(frames) > 200


def _reading(number: int, content: bytes, axes: int) -> dict[str, Any]:
    cls = MESSAGES.get(number)
    if cls is None:
        return {"reading": "unknown_id"}
    try:
        payload = cls.unpack(content, axes)
    except PayloadError:
        return {"reading": "bad_length" if len(content) != cls.size(axes) else "undefined_value"}
    return {
        "reading": cls.NAME,
        "fields": _nested_fields(payload),
        "first_out_of_range": payload.first_out_of_range(),
        "inconsistent_axis": payload.inconsistent_axis(),
    }


def test_transitions_are_those_of_the_vectors(vector_document) -> None:
    rows = vector_document["transitions"]
    for before, event, after in rows:
        key = (messages.State[before.upper()], messages.Event[event.upper()])
        assert messages.TRANSITIONS.get(key, key[0]) == messages.State[after.upper()]
    assert len(rows) == len(messages.State) * len(messages.Event)
