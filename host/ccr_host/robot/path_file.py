"""Path files: text tables of time, y, z and optionally x, in any order, each with its unit."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.text_table import UNIT, TextTable, in_ascii, is_number, shown
from ccr_host.core.user_file import printable

FloatArray = NDArray[np.float64]

_SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
_MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3}
_UNITS = {"t": _SECONDS, "y": _MILLIMETRES, "z": _MILLIMETRES, "x": _MILLIMETRES}
_OWN = ("s", "mm")
_REQUIRED = {"t": "t_s", "y": "y_mm", "z": "z_mm"}
_HEADER = "t_s,y_mm,z_mm[,x_mm]"
_COLUMN = re.compile(rf"(time|[txyz]){UNIT}")
"""``t_s``, ``time (ms)``, ``y [mm]``; or ``y`` alone, which is rejected for its missing unit."""
_MOST_BYTES = 40_000_000
_MOST_ROWS = 1_000_000
_FEWEST_ROWS = 2
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
class _Columns:
    names: list[str]
    """``t``, ``y``, ``z`` or ``x`` for each column."""
    units: list[str]


def read_path_file(file: Path) -> SampledPath:
    """Read and check a path file, any `TextTable`.

    Raises:
        ConfigError: states the file, the line, what is wrong with it and the cure.
    """
    table = TextTable("path file", file, _HEADER, _MOST_BYTES, _columns)
    rows = len(table.lines)
    if not _FEWEST_ROWS <= rows <= _MOST_ROWS:
        raise ConfigError(
            f"{table.name}: {rows} row{'s' * (rows != 1)} of numbers",
            f"give {_FEWEST_ROWS} to {_MOST_ROWS} rows below the header",
        )
    path = _read(table)
    later = path["t"][1:] > path["t"][:-1]
    for (line, _), increases in zip(table.lines[1:], later, strict=True):
        if not increases:
            table.refuse(line, "the time does not increase", "sort the rows by time, once each")
    _require_plausible_units(file, table.columns, path)
    return SampledPath(path["t"], path["y"], path["z"], path.get("x"))


def _columns(cells: list[str]) -> _Columns | str:
    """The columns, or why they are not clear."""
    if all(map(is_number, cells)):
        return f"numbers without a header {_HEADER}"
    seen = printable(", ".join(map(repr, cells)), at_most=80)
    names: list[str] = []
    units: list[str] = []
    unknown: list[str] = []
    for cell in cells:
        column = _COLUMN.fullmatch(in_ascii(cell))
        if column is None:
            unknown.append(cell)
            continue
        name, unit = column[1][0], column[2] or column[3]
        if unit not in _UNITS[name]:
            what = "no unit" if unit is None else f"the unit {shown(unit)}"
            return f"column {shown(cell)} has {what}, not one of {', '.join(_UNITS[name])}"
        names.append(name)
        units.append(unit)
    missing = [column for name, column in _REQUIRED.items() if name not in names]
    if missing:
        return f"no column {missing[0]!r} in {seen}"
    if unknown:
        return f"unknown column {shown(unknown[0])}"
    if len(set(names)) < len(names):
        return f"a column repeated in {seen}"
    return _Columns(names, units)


def _read(table: TextTable[_Columns]) -> dict[str, FloatArray]:
    """Columns by name, in s and mm."""
    values = array("d")
    for line, cells in table.rows():
        for column, cell in zip(table.written, cells, strict=True):
            values.append(table.number(line, column, cell))
    by_column = np.array(values).reshape(len(table.lines), -1).T
    with np.errstate(over="ignore"):
        return {
            name: column * _UNITS[name][unit]
            for name, unit, column in zip(
                table.columns.names, table.columns.units, by_column, strict=True
            )
        }


def _require_plausible_units(file: Path, header: _Columns, table: dict[str, FloatArray]) -> None:
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
