"""Measurements of a robot as CSV: commands and tip positions, each with its unit in the header."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import lines_of, printable, read_text

FloatArray = NDArray[np.float64]

COLUMNS = "t_s,pattern,q1_deg,q2_deg,...,tip_x_mm,tip_y_mm,tip_z_mm"
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3}
_COMMANDS = {"deg": math.radians(1.0), "rad": 1.0, **_MILLIMETRES}
_NUMBERS = re.compile(r"(t|q[1-9]\d*|(?:tip|middle)_[xyz])(?:_(\w+))?")
_UNITS = {"t": _SECONDS, "q": _COMMANDS, "tip": _MILLIMETRES, "middle": _MILLIMETRES}
_WORDS = ("pattern", "count")
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


def read_measured(file: Path) -> Measured:
    """Read and check a file of measurements; the format is that of docs/identify.md.

    Raises:
        ConfigError: states the file, the line or column, what is wrong with it and the cure.
    """
    text, _ = read_text(
        file, "measurements", f"give a CSV file with the columns {COLUMNS}", _MOST_BYTES
    )
    lines = [(n, line) for n, line in enumerate(lines_of(text), 1) if line.strip()]
    lines = [(n, line) for n, line in lines if not line.startswith("#")]
    if not lines:
        raise ConfigError(f"measurements {file}: empty", f"give the columns {COLUMNS}")
    names = [cell.strip() for cell in next(csv.reader([lines[0][1]]))]
    units = _units_of(file, names)
    rows = lines[1:]
    if len(rows) < FEWEST_ROWS:
        raise ConfigError(
            f"measurements {file}: {len(rows)} row{'s' * (len(rows) != 1)}, which identify nothing",
            f"give {FEWEST_ROWS} rows or more: rests over the whole workspace",
        )
    numbers = np.empty((len(rows), len(units)))
    patterns = []
    for place, (line, row) in enumerate(rows):
        cells = next(csv.reader([row]))
        if len(cells) != len(names):
            _refuse(file, line, f"{len(cells)} values for {len(names)} columns", "complete the row")
        of = dict(zip(names, cells, strict=True))
        numbers[place] = [_number(file, line, name, of[name]) * units[name] for name in units]
        patterns.append(of.get("pattern", "").strip())
    table = dict(zip(units, numbers.T, strict=True))
    return _measured(file, [line for line, _ in rows], table, patterns)


def _units_of(file: Path, names: list[str]) -> dict[str, float]:
    """The factor of each column of numbers, by its name in the file."""
    units: dict[str, float] = {}
    found: dict[str, str] = {}
    for name in names:
        column = _NUMBERS.fullmatch(name)
        if name in _WORDS:
            continue
        if column is None:
            raise ConfigError(
                f"measurements {file}: unknown column {printable(name, 30)!r}",
                f"known: {COLUMNS}, middle_x_mm, middle_y_mm, middle_z_mm, count",
            )
        known = _UNITS[re.sub(r"_.*|\d+", "", column[1])]
        if column[2] not in known:
            what = "no unit" if column[2] is None else f"the unit {printable(column[2], 20)!r}"
            raise ConfigError(
                f"measurements {file}: column {name!r} has {what}",
                f"name the column {column[1]}_{' or _'.join(known)}",
            )
        if column[1] in found:
            raise ConfigError(f"measurements {file}: {column[1]} is there twice", "remove one")
        found[column[1]] = name
        units[name] = known[column[2]]
    motors = [name for name in found if name.startswith("q")]
    if not motors:
        _missing(file, "q1_deg or q1_mm")
    for needed in ("t_s", *(f"q{n + 1}" for n in range(len(motors))), *_axes("tip")):
        if re.sub(r"_(s|mm)$", "", needed) not in found:
            _missing(file, needed)
    lengths = [m for m in motors if found[m].rpartition("_")[2] in _MILLIMETRES]
    if lengths and len(lengths) < len(motors):
        raise ConfigError(
            f"measurements {file}: {found[lengths[0]]} is tendon travel, but others are angles",
            "give all commands as travel or all as angles",
        )
    return units


def _axes(of: str) -> tuple[str, ...]:
    return tuple(f"{of}_{axis}_mm" for axis in "xyz")


def _missing(file: Path, column: str) -> NoReturn:
    raise ConfigError(
        f"measurements {file}: no column {column}", f"give the columns {COLUMNS}; q are the motors"
    )


def _number(file: Path, line: int, name: str, cell: str) -> float:
    text = cell.strip()
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) and not (name.startswith("middle") and text.lower() in ("", "nan")):
        _refuse(
            file,
            line,
            f"{name} = {printable(text, 20)!r} is not a finite number",
            "leave out rows in which something was not measured",
        )
    return value


def _measured(
    file: Path, lines: list[int], table: dict[str, FloatArray], patterns: list[str]
) -> Measured:
    by_name = {_base(name): column for name, column in table.items()}
    time_s = by_name["t"]
    for line, later in zip(lines[1:], np.diff(time_s) > 0.0, strict=True):
        if not later:
            _refuse(file, line, "the time does not increase", "sort the rows by time, once each")
    motors = sorted((n for n in by_name if n.startswith("q")), key=lambda name: int(name[1:]))
    command = np.stack([by_name[name] for name in motors], axis=-1)
    for name, range_of in zip(motors, np.ptp(command, axis=0), strict=True):
        if range_of < _CONSTANT:
            raise ConfigError(
                f"measurements {file}: {name} never changes, so nothing of that motor shows",
                "record motions of every motor",
            )
    lengths = any(
        name.startswith("q") and name.rpartition("_")[2] in _MILLIMETRES for name in table
    )
    nothing = np.full(len(time_s), math.nan)
    return Measured(
        time_s,
        command,
        "mm" if lengths else "rad",
        np.stack([by_name[f"tip_{axis}"] for axis in "xyz"], axis=-1),
        np.stack([by_name.get(f"middle_{axis}", nothing) for axis in "xyz"], axis=-1),
        np.array(patterns, dtype=np.str_),
    )


def _base(name: str) -> str:
    return name.rpartition("_")[0]


def _refuse(file: Path, line: int, cause: str, cure: str) -> NoReturn:
    raise ConfigError(f"measurements {file}, line {line}: {cause}", cure)
