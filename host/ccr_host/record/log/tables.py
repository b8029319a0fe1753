"""The log as tables with one value a cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Outcome
from ccr_host.description.schema import Robot
from ccr_host.link.exchange import message_in
from ccr_host.link.framing import decode_single_frame
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


class Group(NamedTuple):
    """Columns side by side, and the cells that a message puts into them."""

    columns: Mapping[str, Column]
    cells: Callable[[LogMessage], Sequence[Cell]]


@dataclass(frozen=True)
class Table:
    """Which messages become its rows, and how."""

    name: str
    meaning: str
    topics: tuple[Topic, ...]
    groups: tuple[Group, ...]

    @cached_property
    def columns(self) -> Mapping[str, Column]:
        """All columns, in their order."""
        return dict(chain.from_iterable(group.columns.items() for group in self.groups))

    def row(self, message: LogMessage) -> Row:
        """The row of a message.

        Raises:
            KeyError, ValueError, TypeError: written by another version.
        """
        cells = chain.from_iterable(group.cells(message) for group in self.groups)
        return dict(zip(self.columns, cells, strict=True))


def _value(name: str, kind: type, meaning: str) -> Group:
    return Group({name: Column(kind, meaning)}, lambda message: [message.content[name]])


def _vector(
    name: str, meaning: str, position: Callable[[Json], Sequence[float] | None] | None = None
) -> Group:
    """A point in mm; of the field of this name by default."""
    position = position or itemgetter(f"{name}_mm")

    def cells(message: LogMessage) -> Sequence[Cell]:
        values_mm = position(message.content)
        components = PATH_AXES.values()
        return [None if values_mm is None else values_mm[component] for component in components]

    columns = {f"{name}_{axis}_mm": Column(float, f"{meaning}, {axis}") for axis in PATH_AXES}
    return Group(columns, cells)


def _motors(robot: Robot, name: str, kind: type, meaning: str) -> Group:
    stem, unit = name.rsplit("_", 1)
    motors = range(1, robot.motors + 1)
    columns = {f"{stem}_{n}_{unit}": Column(kind, f"{meaning}, motor {n}") for n in motors}
    return Group(columns, lambda message: message.content[name] or [None] * len(motors))


def _marker(number: int, name: str) -> Group:
    position = itemgetter(number)
    meaning = f"marker {name}, empty if lost"
    return _vector(name.lower(), meaning, lambda content: position(content["markers_mm"]))


_TIME = Group(
    {"time_us": Column(int, "when, on the run's clock")}, lambda message: [message.time_us]
)
_OUTCOME = (
    _value("outcome", str, "of the controller: " + ", ".join(outcome.value for outcome in Outcome)),
    _value("detail", str, "why, where it is not `solved`, or another remark"),
)


def tables_of(robot: Robot) -> tuple[Table, ...]:
    """The tables of a robot's log."""
    steps = (
        _TIME,
        _value("step", int, "number of the step, from 0"),
        _value("time_s", float, "of the step on the path's clock"),
        *_OUTCOME,
        _value("late", bool, "the command missed its deadline; the last one was repeated"),
        _vector("target", "desired tip"),
        _vector("measured", "measured tip at the end of the step, empty if lost"),
        _vector("true", "the simulated robot's tip, empty on a real one"),
        _motors(robot, "q_rad", float, "command"),
        _value("error_mm", float, "distance of measured and desired tip"),
        _value("measured_age_us", int, "age of the measurement"),
        _value("solve_us", float, "computing time of the controller"),
    )
    commands = (
        _TIME,
        _value("step", int, "for which it was computed, empty while the robot is led to the path"),
        *_OUTCOME,
        _vector("tip", "measured tip as the controller was told, empty if lost"),
        _value("tip_age_us", int, "age of that measurement"),
        _motors(robot, "accepted_rad", float, "command that the board had accepted before"),
        _motors(robot, "command_rad", float, "command"),
        _value("ramp_s", float, "time in which the board goes there"),
        Group(
            {"horizon": Column(int, "steps that were predicted")},
            lambda message: [len(message.content["predicted_mm"])],
        ),
        _vector(
            "predicted",
            "first of the predicted tips, empty without a prediction",
            lambda content: next(iter(content["predicted_mm"]), None),
        ),
        _value("iterations", int, "of the solver, empty where there is none"),
    )
    samples = (
        _TIME,
        _value("exposed_us", int, "when it was exposed, on the run's clock"),
        *(_marker(number, name) for number, name in enumerate(robot.markers)),
    )
    states = (
        _TIME,
        _value("tick", int, "the board's clock, in ticks of 20 ms"),
        _value("state", str, "state of the board"),
        _value("fault", str, "latched fault, or none"),
        _value("flags", int, "status flags, see the protocol"),
        _value("target_sequence", int, "sequence number of the newest target"),
        _value("target_age_ms", int, "age of that target"),
        _motors(robot, "target_cdeg", int, "target, 0.01 deg"),
        _motors(robot, "setpoint_cdeg", int, "setpoint on its way there, 0.01 deg"),
        _motors(robot, "pulse_half_us", int, "pulse width in units of 0.5 us"),
        _value("link_errors", int, "damaged frames that the board has seen"),
        _value("free_stack_bytes", int, "least memory left so far"),
        _value("supply_dv", int, "servo supply, 0.1 V; 0 where it is not measured"),
    )
    frames = (
        _TIME,
        Group({"direction": Column(str, "sent or received")}, _direction),
        _value("name", str, "of the message"),
        _value("sequence", int, "sequence number of the frame"),
        _value("hex", str, "bytes on the wire"),
        Group({"message": Column(str, "the message in words")}, _in_words),
    )
    events = (
        _TIME,
        Group({"text": Column(str, "what happened")}, lambda message: [message.content["message"]]),
    )
    return (
        Table("steps", "one row a control step, at its end", (topics.STEP,), steps),
        Table("commands", "one row a call of the controller", (topics.CONTROL,), commands),
        Table("samples", "one row a measurement of the tracker", (topics.SAMPLE,), samples),
        Table("states", "one row a report of the board", (topics.STATE,), states),
        Table("frames", "one row a frame, both ways", (topics.SENT, topics.RECEIVED), frames),
        Table("events", "phases, faults, interruptions", (topics.EVENT,), events),
    )


def _direction(message: LogMessage) -> Sequence[Cell]:
    return ["sent" if message.topic == topics.SENT.name else "received"]


def _in_words(message: LogMessage) -> Sequence[Cell]:
    return [told_frame(bytes.fromhex(message.content["hex"]))]


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
            row = table.row(message)
        except (KeyError, ValueError, TypeError):
            raise recording.foreign(f"messages on {message.topic}") from None
        if "solve_us" in row:
            row["solve_us"] = solve_times_us.get(message.content["step"])
        yield table, row


def told_frame(data: bytes) -> str:
    """A frame in words: message, fields, sequence number; its bytes where it is none of ours."""
    frame = decode_single_frame(data)
    message = None if frame is None else message_in(frame)
    if frame is None or message is None:
        return data.hex(" ")
    return f"{message} (sequence {frame.sequence})"


if __name__ == "__main__":
    print(dictionary(), end="")
