"""The log as tables with one value a cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ccr_host.link.framing import decode_single_frame
from ccr_host.link.messages import MESSAGES, PayloadError
from ccr_host.run.log import topics
from ccr_host.run.log.reader import LogMessage, RunRecording
from ccr_host.run.log.topics import Topic

Cell = int | float | bool | str | None
Row = dict[str, Cell]
Json = dict[str, Any]

_S_PER_US = 1e-6
_AXES = ("x", "y", "z")
_MARKERS = ("m1", "m2", "m3")


@dataclass(frozen=True)
class Table:
    """Which messages become its rows, and how."""

    name: str
    topics: tuple[Topic, ...]
    columns: Mapping[str, type]
    row: Callable[[LogMessage], Row]


def _vector_columns(name: str) -> dict[str, type]:
    return {f"{name}_{axis}_mm": float for axis in _AXES}


def _vector(name: str, values: Sequence[float] | None) -> Row:
    return dict(zip(_vector_columns(name), values or (None, None, None), strict=True))


def _pair(name: str, values: list[float] | None) -> Row:
    first, second = values or (None, None)
    stem, unit = name.rsplit("_", 1)
    return {f"{stem}_1_{unit}": first, f"{stem}_2_{unit}": second}


def _step(message: LogMessage) -> Row:
    content = message.content
    return {
        "time_us": message.time_us,
        **_plain(content, "step", "time_s", "outcome", "detail", "late"),
        **_vector("target", content["target_mm"]),
        **_vector("measured", content["measured_mm"]),
        **_vector("true", content["true_mm"]),
        **_pair("q_rad", content["q_rad"]),
        **_plain(content, "error_mm", "measured_age_us", "solve_us"),
    }


_STEP_COLUMNS: dict[str, type] = {
    "time_us": int, "step": int, "time_s": float, "outcome": str, "detail": str, "late": bool,
    **_vector_columns("target"), **_vector_columns("measured"), **_vector_columns("true"),
    "q_1_rad": float, "q_2_rad": float, "error_mm": float, "measured_age_us": int,
    "solve_us": float,
}  # fmt: skip


def _command(message: LogMessage) -> Row:
    content = message.content
    predicted = content["predicted_mm"]
    return {
        "time_us": message.time_us,
        **_plain(content, "step", "outcome", "detail"),
        **_vector("tip", content["tip_mm"]),
        **_plain(content, "tip_age_us"),
        **_pair("accepted_rad", content["accepted_rad"]),
        **_pair("command_rad", content["command_rad"]),
        **_plain(content, "ramp_s"),
        "horizon": len(predicted),
        **_vector("predicted", predicted[0] if predicted else None),
        **_plain(content, "iterations"),
    }


_COMMAND_COLUMNS: dict[str, type] = {
    "time_us": int, "step": int, "outcome": str, "detail": str, **_vector_columns("tip"),
    "tip_age_us": int, "accepted_1_rad": float, "accepted_2_rad": float, "command_1_rad": float,
    "command_2_rad": float, "ramp_s": float, "horizon": int, **_vector_columns("predicted"),
    "iterations": int,
}  # fmt: skip


def _sample(message: LogMessage) -> Row:
    row: Row = {"time_us": message.time_us, "exposed_us": message.content["exposed_us"]}
    for name, position_mm in zip(_MARKERS, message.content["markers_mm"], strict=True):
        row |= _vector(name, position_mm)
    return row


_SAMPLE_COLUMNS: dict[str, type] = {"time_us": int, "exposed_us": int}
for _name in _MARKERS:
    _SAMPLE_COLUMNS |= _vector_columns(_name)


def _state(message: LogMessage) -> Row:
    content = message.content
    row: Row = {"time_us": message.time_us}
    for name, value in content.items():
        row |= _pair(name, value) if isinstance(value, list) else {name: value}
    return row


_STATE_COLUMNS: dict[str, type] = {
    "time_us": int, "tick": int, "state": str, "fault": str, "flags": int, "target_sequence": int,
    "target_age_ms": int, "target_1_cdeg": int, "target_2_cdeg": int, "setpoint_1_cdeg": int,
    "setpoint_2_cdeg": int, "pulse_half_1_us": int, "pulse_half_2_us": int, "link_errors": int,
    "free_stack_bytes": int,
}  # fmt: skip


def _frame(message: LogMessage) -> Row:
    return {
        "time_us": message.time_us,
        "direction": "sent" if message.topic == topics.SENT.name else "received",
        **_plain(message.content, "name", "sequence", "hex"),
        "message": told_frame(bytes.fromhex(message.content["hex"])),
    }


_FRAME_COLUMNS: dict[str, type] = {
    "time_us": int, "direction": str, "name": str, "sequence": int, "hex": str, "message": str,
}  # fmt: skip


def _event(message: LogMessage) -> Row:
    return {"time_us": message.time_us, "text": message.content["message"]}


TABLES = (
    Table("steps", (topics.STEP,), _STEP_COLUMNS, _step),
    Table("commands", (topics.CONTROL,), _COMMAND_COLUMNS, _command),
    Table("samples", (topics.SAMPLE,), _SAMPLE_COLUMNS, _sample),
    Table("states", (topics.STATE,), _STATE_COLUMNS, _state),
    Table("frames", (topics.SENT, topics.RECEIVED), _FRAME_COLUMNS, _frame),
    Table("events", (topics.EVENT,), {"time_us": int, "text": str}, _event),
)
"""Times are us on the run's clock; there is a column for each axis and each motor."""


def rows(recording: RunRecording) -> Iterator[tuple[Table, Row]]:
    """Rows of all tables, in the order of the log.

    Raises:
        ConfigError: the log cannot be read.
    """
    solve_times_us = recording.solve_times_us()
    by_topic = {topic.name: table for table in TABLES for topic in table.topics}
    wanted = [topic for table in TABLES for topic in table.topics]
    for message in recording.messages(*wanted):
        table = by_topic[message.topic]
        try:
            row = table.row(message)
        except (KeyError, ValueError, TypeError):
            raise recording.foreign(f"messages on {message.topic}") from None
        if "solve_us" in row:
            row["solve_us"] = solve_times_us.get(message.content["step"])
        yield table, row


def told_frame(data: bytes) -> str:
    """A frame in words: message, fields, sequence number; its bytes where it is none of ours."""
    frame = decode_single_frame(data)
    kind = None if frame is None else MESSAGES.get(frame.id)
    if frame is None or kind is None:
        return data.hex(" ")
    try:
        return f"{kind.unpack(frame.payload)} (sequence {frame.sequence})"
    except PayloadError:
        return data.hex(" ")


def _plain(content: Json, *names: str) -> Row:
    return {name: content[name] for name in names}
