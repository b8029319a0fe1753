"""Measurements of a robot as CSV: commands and tip positions, each with its unit in the header.

Width of the hysteresis and repeatability follow from them without a model.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.arrays import Array, BoolArray, IntArray
from ccr_host.core.errors import ConfigError
from ccr_host.core.text_table import UNIT, TextTable, in_ascii, is_number, shown

COLUMNS = "t_s,pattern,q1_deg,q2_deg,...,tip_x_mm,tip_y_mm,tip_z_mm"
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3}
_COMMANDS = {"deg": math.radians(1.0), "rad": 1.0, **_MILLIMETRES}
MIDDLE = "middle"
"""Another name of m2. The markers below the tip are m2, m3 and so on."""
_FIRST_BELOW = 2
"""Number of the lowest of them."""
_COLUMN = re.compile(rf"(t|q[1-9]\d*|(?:tip|{MIDDLE}|m[2-9]|m1\d)_[xyz]){UNIT}")
_NOT_SEEN = ("", "nan")
"""What stands for a coordinate of a marker below the tip that was not seen."""
_UNITS = {"t": _SECONDS, "q": _COMMANDS, **dict.fromkeys(("tip", MIDDLE, "m"), _MILLIMETRES)}
_MOST = {"t": 1e10, "q": 1e3, "tip": 1e5, MIDDLE: 1e5, "m": 1e5}
"""Plausible values in s (since 1970, too), rad or mm, to either side: beyond, it is a slip or
another unit."""
_WORDS = ("pattern", "count")
_TIP = ("tip_x", "tip_y", "tip_z")
_MOST_BYTES = 100_000_000
FEWEST_ROWS = 20
_CONSTANT = 1e-9


@dataclass(frozen=True, eq=False)
class Measured:
    """What was commanded and seen, one row each time, N rows in the order of time."""

    time_s: Array
    """(N,)."""
    command: Array
    """Motor angles in rad or travel of the motors' tendons in mm, (N, M)."""
    unit: Literal["rad", "mm"]
    tip_mm: Array
    """(N, 3)."""
    below_mm: Array
    """M2 and so on, the markers below the tip, (N, K, 3); NaN where they were not measured."""
    pattern: NDArray[np.str_]
    """Name of the excitation, (N,); empty if it was not given."""

    def kept(self, rows: BoolArray) -> Measured:
        columns = ("time_s", "command", "tip_mm", "below_mm", "pattern")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})

    def ends_mm(self, segments: int) -> Array:
        """Ends of a robot's segments, (N, S, 3), of which the last one is the tip.

        Raises:
            ConfigError: the robot has fewer markers than were measured.
        """
        below = self.below_mm.shape[1]
        if below >= segments:
            raise ConfigError(
                f"measurements of marker m{below + 1} below the tip, but the described robot has "
                f"{segments} segment{'s' * (segments != 1)}",
                "give the description of the measured robot with --robot",
            )
        ends_mm = np.full((len(self.tip_mm), segments, 3), math.nan)
        ends_mm[:, :below], ends_mm[:, -1] = self.below_mm, self.tip_mm
        return ends_mm


@dataclass(frozen=True)
class _Columns:
    names: list[str]
    """``t``, ``q1``, ``tip_x`` and so on, or a word, for each column."""
    factors: list[float]
    """Factor from each column's unit to s, rad or mm; 0 for words."""
    unit: Literal["rad", "mm"]
    """Unit of the commands."""


def read_measured(file: Path) -> Measured:
    """Read and check a file of measurements; the format is that of docs/identify.md.

    Raises:
        ConfigError: states the file, the line or column, what is wrong with it and the cure.
    """
    table = TextTable("measurements", file, COLUMNS, _MOST_BYTES, _columns)
    rows = len(table.lines)
    if rows < FEWEST_ROWS:
        raise ConfigError(
            f"{table.name}: {rows} row{'s' * (rows != 1)}, which identify nothing",
            f"give {FEWEST_ROWS} rows or more: rests over the whole workspace",
        )
    columns = table.columns
    values: dict[str, Array] = {name: np.full(rows, math.nan) for name in columns.names}
    patterns = [""] * rows
    for row, (line, cells) in enumerate(table.rows()):
        described = zip(columns.names, columns.factors, table.written, cells, strict=True)
        for name, factor, written, cell in described:
            if name == "pattern":
                patterns[row] = cell
            elif name not in _WORDS and not (name.startswith("m") and cell.lower() in _NOT_SEEN):
                value = factor * table.number(line, written, cell)
                if abs(value) > _MOST[_kind(name)]:
                    table.refuse(
                        line,
                        f"{written} = {shown(cell)}, which no robot reaches",
                        "correct the number, or the unit in the header",
                    )
                values[name][row] = value
    for (line, _), later in zip(table.lines[1:], np.diff(values["t"]) > 0.0, strict=True):
        if not later:
            table.refuse(line, "the time does not increase", "sort the rows by time, once each")
    command = np.stack([values[name] for name in _motors(columns.names)], axis=-1)
    for number, range_of in enumerate(np.ptp(command, axis=0), 1):
        if range_of < _CONSTANT:
            raise ConfigError(
                f"{table.name}: q{number} never changes, so nothing of that motor shows",
                "record motions of every motor",
            )
    below = {int(name[1:-2]) for name in columns.names if name.startswith("m")}
    below_mm = np.full((rows, max(below, default=1) + 1 - _FIRST_BELOW, 3), math.nan)
    for number, (axis, letter) in itertools.product(below, enumerate("xyz")):
        below_mm[:, number - _FIRST_BELOW, axis] = values.get(f"m{number}_{letter}", math.nan)
    return Measured(
        values["t"],
        command,
        columns.unit,
        np.stack([values[f"tip_{axis}"] for axis in "xyz"], axis=-1),
        below_mm,
        np.array(patterns, dtype=np.str_),
    )


def _kind(name: str) -> str:
    """What a column holds: its name without number and axis."""
    return re.sub(r"_.*|\d+", "", name)


def _columns(cells: list[str]) -> _Columns | str:
    """The columns, or why they are not clear."""
    if all(map(is_number, cells)):
        return f"numbers without a header {COLUMNS}"
    names: list[str] = []
    factors: list[float] = []
    units: dict[str, str] = {}
    for cell in cells:
        name = in_ascii(cell)
        column = _COLUMN.fullmatch(name)
        if column is not None:
            name, unit = column[1], column[2] or column[3]
            known = _UNITS[_kind(name)]
            if unit not in known:
                what = "no unit" if unit is None else f"the unit {shown(unit)}"
                return f"column {shown(cell)} has {what}, not one of {', '.join(known)}"
            name = name.replace(MIDDLE, f"m{_FIRST_BELOW}")
            units[name] = unit
        elif name not in _WORDS:
            return f"unknown column {shown(cell)}"
        if name in names:
            return f"{name} is there twice"
        names.append(name)
        factors.append(0.0 if column is None else known[unit])
    return _incomplete(names, units) or _Columns(
        names, factors, "mm" if units["q1"] in _MILLIMETRES else "rad"
    )


def _incomplete(names: list[str], units: dict[str, str]) -> str:
    """What is missing, or does not belong together; empty if all is there."""
    motors = _motors(names)
    for needed in ("t", "q1", *(f"q{n + 1}" for n in range(len(motors))), *_TIP):
        if needed not in names:
            return f"no column {needed}, with its unit"
    lengths = [name for name in motors if units[name] in _MILLIMETRES]
    if lengths and len(lengths) < len(motors):
        return f"{lengths[0]} is tendon travel, but others are angles"
    return ""


def _motors(names: list[str]) -> list[str]:
    return sorted((n for n in names if n.startswith("q")), key=lambda name: int(name[1:]))


_STILL_SHARE = 0.004
"""Share of the range of commands: smaller steps are resolution, not motion."""
_SAME_WAY, _OPPOSITE = 0.95, -0.95
"""Cosines between steps of a sweep, and between a sweep and the one back."""
_FEWEST_STEPS = 4
_INNER = np.linspace(0.2, 0.8, 13)
"""Part of the common range in which both ways are compared: near the turn they are the same."""
_LEAST_COMMON_SHARE = 0.5
_OFF_LINE_SHARE = 0.05
_LONGEST_PAUSE_S = 30.0
_FEWEST_VISITS = 2
_HOME_SHARE = 0.01
"""Share of the range of commands within which all motors are at home, 0."""


@dataclass(frozen=True)
class Sweep:
    """The same commands from both sides, means over the sweep."""

    row: int
    """Where the way there begins."""
    pattern: str
    motor: int
    """The motor that moves most, from 1."""
    tip_mm: float
    """Distance between the tips."""
    command: float
    """Travel of that motor, mm or rad, that moves the tip by this distance."""


@dataclass(frozen=True)
class Home:
    """Visits to home, all motors at 0."""

    visits: int
    rms_mm: float
    """RMS distance of the tip from the mean of the visits."""
    max_mm: float


def sweeps_of(measured: Measured) -> list[Sweep]:
    """All motions there and back along the same line of commands."""
    found = []
    runs = _runs(measured)
    for there, back in itertools.pairwise(runs):
        if back[0] > there[-1] + len(there) or (
            measured.time_s[back[0]] - measured.time_s[there[-1]] > _LONGEST_PAUSE_S
        ):
            continue
        sweep = _sweep(measured, there, back)
        if sweep is not None:
            found.append(sweep)
    return found


def _runs(measured: Measured) -> list[IntArray]:
    """Rows of each motion in one direction, without those at which the motors stood."""
    command = measured.command
    still = _STILL_SHARE * float(np.ptp(command, axis=0).max())
    runs: list[list[int]] = []
    last, way = 0, np.zeros(command.shape[1])
    for row in range(1, len(command)):
        step = command[row] - command[last]
        size = float(np.linalg.norm(step))
        if size < still:
            continue
        same_pattern = measured.pattern[row] == measured.pattern[last]
        if runs and same_pattern and float(step @ way) > _SAME_WAY * size * np.linalg.norm(way):
            runs[-1].append(row)
        else:
            runs.append([last, row] if same_pattern else [row])
        last, way = row, step
    return [np.array(run) for run in runs if len(run) > _FEWEST_STEPS]


def _sweep(measured: Measured, there: IntArray, back: IntArray) -> Sweep | None:
    if measured.pattern[there[0]] != measured.pattern[back[0]]:
        return None
    command, tip = measured.command, measured.tip_mm
    out = command[there[-1]] - command[there[0]]
    home = command[back[-1]] - command[back[0]]
    length = float(np.linalg.norm(out))
    if float(out @ home) > _OPPOSITE * length * float(np.linalg.norm(home)):
        return None
    way, start = out / length, command[there[0]]
    rows = np.concatenate([there, back])
    along = (command[rows] - start) @ way
    off = command[rows] - start - along[:, None] * way
    if np.linalg.norm(off, axis=1).max() > _OFF_LINE_SHARE * length:
        return None
    first, second = along[: len(there)], along[len(there) :]
    low, high = max(first.min(), second.min()), min(first.max(), second.max())
    if high - low < _LEAST_COMMON_SHARE * length:
        return None
    at = low + _INNER * (high - low)
    up, down = _interpolated(at, first, tip[there]), _interpolated(at, second, tip[back])
    gap_mm = float(np.linalg.norm(up - down, axis=1).mean())
    motor = int(np.argmax(np.abs(way)))
    travelled_mm = float(np.linalg.norm(np.diff(0.5 * (up + down), axis=0), axis=1).sum())
    per_command = travelled_mm / (abs(float(way[motor])) * float(at[-1] - at[0]))
    return Sweep(
        int(there[0]), str(measured.pattern[there[0]]), motor + 1, gap_mm, gap_mm / per_command
    )


def _interpolated(at: Array, along: Array, tip_mm: Array) -> Array:
    order = np.argsort(along)
    return np.stack([np.interp(at, along[order], column[order]) for column in tip_mm.T], axis=-1)


def home_of(measured: Measured) -> Home | None:
    """Repeatability at home; None if it was not visited twice."""
    near = _HOME_SHARE * float(np.ptp(measured.command, axis=0).max())
    there = (np.abs(measured.command).max(axis=1) < near).astype(int)
    turns = np.diff(np.concatenate([[0], there, [0]]))
    starts, ends = np.flatnonzero(turns > 0), np.flatnonzero(turns < 0)
    visits = np.array(
        [measured.tip_mm[a:b].mean(axis=0) for a, b in zip(starts, ends, strict=True)]
    )
    if len(visits) < _FEWEST_VISITS:
        return None
    off_mm = np.linalg.norm(visits - visits.mean(axis=0), axis=1)
    return Home(len(visits), float(np.sqrt((off_mm**2).mean())), float(off_mm.max()))
