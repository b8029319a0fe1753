"""The log as tables with one value a cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Outcome
from ccr_host.description.schema import Robot
from ccr_host.link.framing import decode_single_frame
from ccr_host.link.messages import MESSAGES, PayloadError
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogMessage, RunRecording
from ccr_host.record.log.topics import Topic
from ccr_host.robot.reference import PATH_AXES

Cell = int | float | bool | str | None
Row = dict[str, Cell]
Json = dict[str, Any]
Arrays = dict[str, NDArray[Any]]
"""Columns of a table by name."""


class Column(NamedTuple):
    """What stands in one column."""

    kind: type
    meaning: str


Columns = Mapping[str, Column]


@dataclass(frozen=True)
class Table:
    """Which messages become its rows, and how."""

    name: str
    meaning: str
    topics: tuple[Topic, ...]
    columns: Columns
    row: Callable[[LogMessage], Row]


def _vector_columns(name: str, meaning: str) -> dict[str, Column]:
    return {f"{name}_{axis}_mm": Column(float, f"{meaning}, {axis}") for axis in PATH_AXES}


def _vector(name: str, values: Sequence[float] | None) -> Row:
    return {
        f"{name}_{axis}_mm": None if values is None else values[component]
        for axis, component in PATH_AXES.items()
    }


def _motor_columns(
    robot: Robot, stem: str, unit: str, kind: type, meaning: str
) -> dict[str, Column]:
    motors = range(1, robot.motors + 1)
    return {f"{stem}_{n}_{unit}": Column(kind, f"{meaning}, motor {n}") for n in motors}


def _per_motor(name: str, values: Sequence[float] | None) -> Row:
    stem, unit = name.rsplit("_", 1)
    return {f"{stem}_{n}_{unit}": value for n, value in enumerate(values or (), 1)}


_TIME = {"time_us": Column(int, "when, on the run's clock")}
_OUTCOME = {
    "outcome": Column(str, "of the controller: " + ", ".join(outcome.value for outcome in Outcome)),
    "detail": Column(str, "why, where it is not `solved`"),
}


def _step(message: LogMessage) -> Row:
    content = message.content
    return {
        "time_us": message.time_us,
        **_plain(content, "step", "time_s", "outcome", "detail", "late"),
        **_vector("target", content["target_mm"]),
        **_vector("measured", content["measured_mm"]),
        **_vector("true", content["true_mm"]),
        **_per_motor("q_rad", content["q_rad"]),
        **_plain(content, "error_mm", "measured_age_us", "solve_us"),
    }


def _step_columns(robot: Robot) -> Columns:
    return {
        **_TIME,
        "step": Column(int, "number of the step, from 0"),
        "time_s": Column(float, "of the step on the path's clock"),
        **_OUTCOME,
        "late": Column(bool, "the command missed its deadline; the last one was repeated"),
        **_vector_columns("target", "desired tip"),
        **_vector_columns("measured", "measured tip at the end of the step, empty if lost"),
        **_vector_columns("true", "the simulated robot's tip, empty on a real one"),
        **_motor_columns(robot, "q", "rad", float, "command"),
        "error_mm": Column(float, "distance of measured and desired tip"),
        "measured_age_us": Column(int, "age of the measurement"),
        "solve_us": Column(float, "computing time of the controller"),
    }


def _command(message: LogMessage) -> Row:
    content = message.content
    predicted = content["predicted_mm"]
    return {
        "time_us": message.time_us,
        **_plain(content, "step", "outcome", "detail"),
        **_vector("tip", content["tip_mm"]),
        **_plain(content, "tip_age_us"),
        **_per_motor("accepted_rad", content["accepted_rad"]),
        **_per_motor("command_rad", content["command_rad"]),
        **_plain(content, "ramp_s"),
        "horizon": len(predicted),
        **_vector("predicted", predicted[0] if predicted else None),
        **_plain(content, "iterations"),
    }


def _command_columns(robot: Robot) -> Columns:
    accepted = "command that the board had accepted before"
    return {
        **_TIME,
        "step": Column(int, "for which it was computed, empty while the robot is led to the path"),
        **_OUTCOME,
        **_vector_columns("tip", "measured tip as the controller was told, empty if lost"),
        "tip_age_us": Column(int, "age of that measurement"),
        **_motor_columns(robot, "accepted", "rad", float, accepted),
        **_motor_columns(robot, "command", "rad", float, "command"),
        "ramp_s": Column(float, "time in which the board goes there"),
        "horizon": Column(int, "steps that were predicted"),
        **_vector_columns("predicted", "first of the predicted tips, empty without a prediction"),
        "iterations": Column(int, "of the solver, empty where there is none"),
    }


def _sample(message: LogMessage) -> Row:
    row: Row = {"time_us": message.time_us, "exposed_us": message.content["exposed_us"]}
    for number, position_mm in enumerate(message.content["markers_mm"], 1):
        row |= _vector(f"m{number}", position_mm)
    return row


def _sample_columns(robot: Robot) -> Columns:
    columns = {**_TIME, "exposed_us": Column(int, "when it was exposed, on the run's clock")}
    for marker in robot.markers:
        columns |= _vector_columns(marker.lower(), f"marker {marker}, empty if lost")
    return columns


def _state(message: LogMessage) -> Row:
    content = message.content
    row: Row = {"time_us": message.time_us}
    for name, value in content.items():
        row |= _per_motor(name, value) if isinstance(value, list) else {name: value}
    return row


def _state_columns(robot: Robot) -> Columns:
    return {
        **_TIME,
        "tick": Column(int, "the board's clock, in ticks of 20 ms"),
        "state": Column(str, "state of the board"),
        "fault": Column(str, "latched fault, or none"),
        "flags": Column(int, "status flags, see the protocol"),
        "target_sequence": Column(int, "sequence number of the newest target"),
        "target_age_ms": Column(int, "age of that target"),
        **_motor_columns(robot, "target", "cdeg", int, "target, 0.01 deg"),
        **_motor_columns(robot, "setpoint", "cdeg", int, "setpoint on its way there, 0.01 deg"),
        **_motor_columns(robot, "pulse_half", "us", int, "pulse width in units of 0.5 us"),
        "link_errors": Column(int, "damaged frames that the board has seen"),
        "free_stack_bytes": Column(int, "least memory left so far"),
        "supply_dv": Column(int, "servo supply, 0.1 V; 0 where it is not measured"),
    }


def _frame(message: LogMessage) -> Row:
    return {
        "time_us": message.time_us,
        "direction": "sent" if message.topic == topics.SENT.name else "received",
        **_plain(message.content, "name", "sequence", "hex"),
        "message": told_frame(bytes.fromhex(message.content["hex"])),
    }


_FRAME_COLUMNS: Columns = {
    **_TIME,
    "direction": Column(str, "sent or received"),
    "name": Column(str, "of the message"),
    "sequence": Column(int, "sequence number of the frame"),
    "hex": Column(str, "bytes on the wire"),
    "message": Column(str, "the message in words"),
}


def _event(message: LogMessage) -> Row:
    return {"time_us": message.time_us, "text": message.content["message"]}


_EVENT_COLUMNS: Columns = {**_TIME, "text": Column(str, "what happened")}


def tables_of(robot: Robot) -> tuple[Table, ...]:
    """The tables of a robot's log."""
    return (
        Table(
            "steps",
            "one row a control step, at its end",
            (topics.STEP,),
            _step_columns(robot),
            _step,
        ),
        Table(
            "commands",
            "one row a call of the controller",
            (topics.CONTROL,),
            _command_columns(robot),
            _command,
        ),
        Table(
            "samples",
            "one row a measurement of the tracker",
            (topics.SAMPLE,),
            _sample_columns(robot),
            _sample,
        ),
        Table(
            "states",
            "one row a report of the board",
            (topics.STATE,),
            _state_columns(robot),
            _state,
        ),
        Table(
            "frames",
            "one row a frame, both ways",
            (topics.SENT, topics.RECEIVED),
            _FRAME_COLUMNS,
            _frame,
        ),
        Table("events", "phases, faults, interruptions", (topics.EVENT,), _EVENT_COLUMNS, _event),
    )


def dictionary() -> str:
    """All columns for two motors as Markdown, as docs/logs.md has them."""
    lines: list[str] = []
    for table in tables_of(Robot()):
        lines += [
            f"### {table.name}: {table.meaning}",
            "",
            "| column | type | meaning |",
            "|---|---|---|",
        ]
        lines += [
            f"| `{name}` | {c.kind.__name__} | {c.meaning} |" for name, c in table.columns.items()
        ]
        lines.append("")
    return "\n".join(lines[:-1]) + "\n"


def arrays(recording: RunRecording, table: Table) -> Arrays:
    """One table, (N,) per column; a missing number becomes NaN, a missing text is empty.

    Raises:
        ConfigError: the log cannot be read.
    """
    found = [row for _, row in rows(recording, [table])]
    return {
        name: _array([row[name] for row in found], column.kind)
        for name, column in table.columns.items()
    }


def _array(cells: Sequence[Cell], kind: type) -> NDArray[Any]:
    if kind is str:
        return np.array([cell or "" for cell in cells], dtype=np.str_)
    is_complete = not any(cell is None for cell in cells)
    return np.array(cells, dtype=kind if is_complete else np.float64)


def rows(recording: RunRecording, tables: Sequence[Table]) -> Iterator[tuple[Table, Row]]:
    """Rows of these tables, in the order of the log.

    Raises:
        ConfigError: the log cannot be read.
    """
    solve_times_us = recording.solve_times_us()
    by_topic = {topic.name: table for table in tables for topic in table.topics}
    wanted = [topic for table in tables for topic in table.topics]
    for message in recording.messages(*wanted):
        table = by_topic[message.topic]
        try:
            row = dict.fromkeys(table.columns) | table.row(message)
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


if __name__ == "__main__":
    print(dictionary(), end="")
