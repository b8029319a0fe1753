"""Path files: text tables of time, y, z and optionally x, in any order, each with its unit."""

from __future__ import annotations

import csv
import math
import re
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import lines_of, printable, read_text

FloatArray = NDArray[np.float64]
Line = tuple[int, str]
"""Line number, and content without comments."""

_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3}
_UNITS = {"t": _SECONDS, "y": _MILLIMETRES, "z": _MILLIMETRES, "x": _MILLIMETRES}
_OWN = ("s", "mm")
_REQUIRED = {"t": "t_s", "y": "y_mm", "z": "z_mm"}
_HEADER = "t_s,y_mm,z_mm[,x_mm]"
_COLUMN = re.compile(r"(time|[txyz])(?:[\s_]*[(\[]\s*(\w+)\s*[)\]]|[\s_]+(\w+))?")
"""``t_s``, ``time (ms)``, ``y [mm]``; or ``y`` alone, which is rejected for its missing unit."""
_COMMENT = re.compile(r"#(.*)|^\s*(?:%|//)(.*)")
_SEPARATORS = ";\t,|"
_NOTHING = re.compile(r"[\s;,|]*|sep=.*", re.IGNORECASE)
"""Blank, or added by spreadsheets: empty cells, and the ``sep=`` line."""
_MOST_BYTES = 40_000_000
_MOST_ROWS = 1_000_000
_FEWEST_ROWS = 2
_LONGEST_SHOWN = 20
_FARTHEST_MM = 100_000.0
"""100 times the longest segment that a description may have."""
_NEAR_MM = 1.0
"""A path that stays this close to the straight robot was probably written in metres."""
_SLOW_MM_S, _SPARSE_S = 0.02, 5.0
"""A path this slow, with rows this far apart, was probably written in milliseconds: the paper's
paths run at 3 to 10 mm/s."""


@dataclass(frozen=True)
class SampledPath:
    """A sampled path, arrays of (N,); ``x_mm`` is None if it follows from the model."""

    time_s: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    x_mm: FloatArray | None

    def resampled(self, time_s: FloatArray) -> SampledPath:
        """Interpolate linearly at ``time_s``, which counts from the first sample."""
        own = self.time_s - self.time_s[0]
        x = None if self.x_mm is None else np.interp(time_s, own, self.x_mm)
        y, z = np.interp(time_s, own, self.y_mm), np.interp(time_s, own, self.z_mm)
        return SampledPath(time_s, y, z, x)


@dataclass(frozen=True)
class _Header:
    separator: str | None
    """None for spaces."""
    written: list[str]
    """Column names as written in the file."""
    names: list[str]
    """``t``, ``y``, ``z`` or ``x`` for each column."""
    units: list[str]


def read_path_file(file: Path) -> SampledPath:
    """Read and check a path file.

    Commas, semicolons, tabs or spaces separate the columns; quotes, comments, capitals and decimal
    commas are accepted where they are unambiguous.

    Raises:
        ConfigError: states the file, the line, what is wrong with it and the cure.
    """
    text, _ = read_text(
        file, "path file", f"give a text file with the columns {_HEADER}", _MOST_BYTES
    )
    lines, comment = _without_comments(text)
    if "\0" in text or not lines:
        why = (
            "empty" if not text.strip() else "not text" if "\0" in text else "nothing but comments"
        )
        raise ConfigError(f"path file {file}: {why}", f"give a header {_HEADER} and two rows")
    # The header may be a comment, as numpy.savetxt writes it.
    starts_with = re.split(r"[;\t,| ]", lines[0][1])[0]
    header = _header(comment[1]) if comment is not None and _is_number(starts_with) else None
    rows = lines
    if not isinstance(header, _Header):
        header, rows = _header(lines[0][1]), lines[1:]
    if isinstance(header, str):
        _refuse(file, lines[0][0], header, f"the header is {_HEADER}")
    if not _FEWEST_ROWS <= len(rows) <= _MOST_ROWS:
        raise ConfigError(
            f"path file {file}: {len(rows)} row{'s' * (len(rows) != 1)} of numbers",
            f"give {_FEWEST_ROWS} to {_MOST_ROWS} rows below the header",
        )
    table = _table(file, header, rows)
    later = table["t"][1:] > table["t"][:-1]
    for (line, _), increases in zip(rows[1:], later, strict=True):
        if not increases:
            _refuse(file, line, "the time does not increase", "sort the rows by time, once each")
    _require_plausible_units(file, header, table)
    return SampledPath(table["t"], table["y"], table["z"], table.get("x"))


def _without_comments(text: str) -> tuple[list[Line], Line | None]:
    """The lines with content, and the last comment above them."""
    lines: list[Line] = []
    comment: Line | None = None
    for number, whole in enumerate(lines_of(text), 1):
        found = _COMMENT.search(whole)
        content = (whole if found is None else whole[: found.start()]).strip(" ")
        if not _NOTHING.fullmatch(content):
            lines.append((number, content))
        elif found is not None and not lines:
            comment = number, found[1] or found[2] or ""
    return lines, comment


def _header(line: str) -> _Header | str:
    """The columns, or why they are not clear."""
    separators = [None, *(separator for separator in _SEPARATORS if separator in line)][::-1]
    found = [_columns(separator, _cells(line, separator)) for separator in separators]
    return next((header for header in found if isinstance(header, _Header)), found[0])


def _columns(separator: str | None, cells: list[str]) -> _Header | str:
    while cells and not cells[-1]:
        cells.pop()
    if all(map(_is_number, cells)):
        return f"numbers without a header {_HEADER}"
    seen = printable(", ".join(map(repr, cells)), at_most=80)
    names: list[str] = []
    units: list[str] = []
    unknown: list[str] = []
    for cell in cells:
        column = _COLUMN.fullmatch(cell.lower().replace("µ", "u").replace("μ", "u"))
        if column is None:
            unknown.append(cell)
            continue
        name, unit = column[1][0], column[2] or column[3]
        if unit not in _UNITS[name]:
            what = "no unit" if unit is None else f"the unit {_shown(unit)}"
            return f"column {_shown(cell)} has {what}, not one of {', '.join(_UNITS[name])}"
        names.append(name)
        units.append(unit)
    missing = [shown for name, shown in _REQUIRED.items() if name not in names]
    if missing:
        return f"no column {missing[0]!r} in {seen}"
    if unknown:
        return f"unknown column {_shown(unknown[0])}"
    if len(set(names)) < len(names):
        return f"a column repeated in {seen}"
    return _Header(separator, cells, names, units)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        cells = line.split()
    else:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip().strip("'\"").strip() for cell in cells]


def _table(file: Path, header: _Header, rows: list[Line]) -> dict[str, FloatArray]:
    """Columns by name, in s and mm."""
    values = array("d")
    decimal_mark = ""
    for line, text in rows:
        try:
            cells = _cells(text, header.separator)
        except csv.Error as error:
            _refuse(file, line, str(error), "write plain numbers")
        while len(cells) > len(header.names) and not cells[-1]:
            cells.pop()
        if len(cells) != len(header.names):
            _refuse(
                file,
                line,
                f"{len(cells)} values for {len(header.names)} columns",
                "give one value for each column; where commas are decimal, separate them by ;",
            )
        for column, cell in zip(header.written, cells, strict=True):
            mark = "".join(sorted(set(cell) & {",", "."}))
            value = _number(cell)
            differs = mark != (decimal_mark or mark)
            if not math.isfinite(value) or (mark and differs):
                cure = "give a finite number, nothing else in the column"
                if len(re.findall("[.,]", cell)) > 1:
                    cure = "write numbers without marks between the thousands"
                elif mark and differs:
                    cure = "give all numbers the same decimal mark"
                _refuse(file, line, f"{column} = {_shown(cell)}", cure)
            decimal_mark = decimal_mark or mark
            values.append(value)
    columns = np.array(values).reshape(len(rows), -1).T
    with np.errstate(over="ignore"):
        return {
            name: column * _UNITS[name][unit]
            for name, unit, column in zip(header.names, header.units, columns, strict=True)
        }


def _require_plausible_units(file: Path, header: _Header, table: dict[str, FloatArray]) -> None:
    """Reject coordinates out of reach, and paths in s and mm that were probably meant otherwise."""
    own = {name for name, unit in zip(header.names, header.units, strict=True) if unit in _OWN}
    mm = np.stack([table[name] for name in "yzx" if name in table])
    largest_mm = float(np.abs(mm).max())
    if largest_mm > _FARTHEST_MM:
        raise ConfigError(
            f"path file {file}: a coordinate of {largest_mm:.3g} mm, which no robot reaches",
            f"correct the number, or the unit in the header; {_FARTHEST_MM:.0f} mm are allowed",
        )
    if own.issuperset(name for name in "yzx" if name in table) and 0 < largest_mm < _NEAR_MM:
        raise ConfigError(
            f"path file {file}: no coordinate above {largest_mm:.3g} mm; are these metres?",
            "name the columns y_m and z_m then; for a path so small give y_um and z_um",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        period_s = float(np.median(np.diff(table["t"])))
        length_mm = float(np.linalg.norm(np.diff(mm, axis=1), axis=0).sum())
        speed_mm_s = length_mm / (table["t"][-1] - table["t"][0])
    if "t" in own and period_s > _SPARSE_S and 0 < speed_mm_s < _SLOW_MM_S:
        raise ConfigError(
            f"path file {file}: rows {period_s:g} s apart, {speed_mm_s:.2g} mm/s along the path; "
            "are these milliseconds?",
            "name the column t_ms then; for a path so slow give t_min",
        )


def _number(text: str) -> float:
    """The number that the text stands for; NaN if it is not a number."""
    if "_" in text:  # Python would ignore it
        return math.nan
    try:
        return float(text.replace(",", ".").replace("\N{MINUS SIGN}", "-"))
    except ValueError:
        return math.nan


def _is_number(text: str) -> bool:
    return not math.isnan(_number(text))


def _shown(text: str) -> str:
    """A cell for messages: shortened, control characters escaped."""
    return repr(text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "...")


def _refuse(file: Path, line: int, cause: str, cure: str) -> NoReturn:
    raise ConfigError(f"path file {file}, line {line}: {cause}", cure)
