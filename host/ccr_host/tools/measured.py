"""Measurements of a robot as CSV: commands and tip positions, each with its unit in the header."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.text_table import UNIT, TextTable, in_ascii, is_number, shown

FloatArray = NDArray[np.float64]

COLUMNS = "t_s,pattern,q1_deg,q2_deg,...,tip_x_mm,tip_y_mm,tip_z_mm"
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3}
_COMMANDS = {"deg": math.radians(1.0), "rad": 1.0, **_MILLIMETRES}
MIDDLE = "middle"
"""M2 of a robot of two segments; of longer ones the markers below the tip are m2, m3 and so on."""
_COLUMN = re.compile(rf"(t|q[1-9]\d*|(?:tip|{MIDDLE}|m[2-9]|m1\d)_[xyz]){UNIT}")
_NOT_SEEN = ("", "nan")
"""In place of a coordinate of a marker below the tip."""
_UNITS = {"t": _SECONDS, "q": _COMMANDS, **dict.fromkeys(("tip", MIDDLE, "m"), _MILLIMETRES)}
_MOST = {"t": 1e8, "q": 1e3, "tip": 1e5, MIDDLE: 1e5, "m": 1e5}
"""Plausible values in s, rad or mm, to either side: beyond, it is a slip or another unit."""
_WORDS = ("pattern", "count")
_TIP = ("tip_x", "tip_y", "tip_z")
_MOST_BYTES = 100_000_000
FEWEST_ROWS = 20
_CONSTANT = 1e-9


@dataclass(frozen=True, eq=False)
class Measured:
    """What was commanded and seen, one row each time, N rows in the order of time."""

    time_s: FloatArray
    """(N,)."""
    command: FloatArray
    """Motor angles in rad or travel of the motors' tendons in mm, (N, M)."""
    unit: Literal["rad", "mm"]
    tip_mm: FloatArray
    """(N, 3)."""
    middle_mm: FloatArray
    """M2, (N, 3); NaN if it was not measured."""
    pattern: NDArray[np.str_]
    """Name of the excitation, (N,); empty if it was not given."""

    def kept(self, rows: NDArray[np.bool_]) -> Measured:
        """Some of the rows."""
        return Measured(
            self.time_s[rows],
            self.command[rows],
            self.unit,
            self.tip_mm[rows],
            self.middle_mm[rows],
            self.pattern[rows],
        )


@dataclass(frozen=True)
class _Columns:
    names: list[str]
    """``t``, ``q1``, ``tip_x`` and so on, or a word, for each column."""
    factors: list[float]
    """From each column's unit to s, rad or mm; 0 for words."""
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
    values: dict[str, FloatArray] = {name: np.full(rows, math.nan) for name in columns.names}
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
    nothing = np.full(rows, math.nan)
    return Measured(
        values["t"],
        command,
        columns.unit,
        np.stack([values[f"tip_{axis}"] for axis in "xyz"], axis=-1),
        np.stack([values.get(f"{MIDDLE}_{axis}", nothing) for axis in "xyz"], axis=-1),
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
