"""Paths from CSV files: columns t_s, y_mm, z_mm and optionally x_mm, in any order."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ccr_host.errors import ConfigError

FloatArray = NDArray[np.float64]

_REQUIRED = ("t_s", "y_mm", "z_mm")
_OPTIONAL = ("x_mm",)
_HEADER = "t_s,y_mm,z_mm[,x_mm]"
_FEWEST_ROWS = 2
_LONGEST_SHOWN = 20


@dataclass(frozen=True)
class SampledPath:
    """A path as samples, all (N,); ``x_mm`` None where the model decides it."""

    time_s: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    x_mm: FloatArray | None

    def resampled(self, time_s: FloatArray) -> SampledPath:
        """Linear between the samples; ``time_s`` counts from the first one."""
        own = self.time_s - self.time_s[0]
        x = None if self.x_mm is None else np.interp(time_s, own, self.x_mm)
        y, z = np.interp(time_s, own, self.y_mm), np.interp(time_s, own, self.z_mm)
        return SampledPath(time_s, y, z, x)


def read_path_file(file: Path) -> SampledPath:
    """Read and check a path file.

    Raises:
        ConfigError: names the file, the line, what is wrong with it and the cure.
    """
    reader = csv.reader(_read_text(file).splitlines(), strict=True)
    try:
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise _bad_line(
            file, reader.line_num, str(error), "write plain numbers and commas"
        ) from None
    if not lines:
        raise ConfigError(
            f"path file {file}: empty", f"give a header {_HEADER} and two rows or more"
        )
    columns = _columns(file, *lines[0])
    rows = [_numbers(file, line, row, columns) for line, row in lines[1:]]
    if len(rows) < _FEWEST_ROWS:
        raise ConfigError(
            f"path file {file}: {len(rows)} row{'s' * (len(rows) != 1)} of numbers",
            "give two rows or more below the header",
        )
    table = dict(zip(columns, np.array(rows).T, strict=True))
    later = table["t_s"][1:] > table["t_s"][:-1]
    for (line, _), increases in zip(lines[2:], later, strict=True):
        if not increases:
            raise _bad_line(file, line, "t_s does not increase", "sort the rows by time, once each")
    return SampledPath(table["t_s"], table["y_mm"], table["z_mm"], table.get("x_mm"))


def _read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(
            f"path file {file}: {error.strerror}", "give an existing, readable CSV file"
        ) from None
    except UnicodeDecodeError:
        raise ConfigError(f"path file {file}: not text", "give a CSV file in UTF-8") from None
    except ValueError as error:
        raise ConfigError(f"path file {file}: {error}", "give the name of a CSV file") from None


def _columns(file: Path, line: int, header: list[str]) -> list[str]:
    names = [name.strip() for name in header]
    missing = [name for name in _REQUIRED if name not in names]
    unknown = [name for name in names if name not in _REQUIRED + _OPTIONAL]
    repeated = [name for name in names if names.count(name) > 1]
    for problem, found in (
        ("no column", missing),
        ("unknown column", unknown),
        ("repeated", repeated),
    ):
        if found:
            raise _bad_line(file, line, f"{problem} {found[0]!r}", f"the header is {_HEADER}")
    return names


def _numbers(file: Path, line: int, row: list[str], columns: list[str]) -> list[float]:
    if len(row) != len(columns):
        cause = f"{len(row)} values for {len(columns)} columns"
        raise _bad_line(file, line, cause, "give one value for each column")
    return [_number(file, line, *pair) for pair in zip(columns, row, strict=True)]


def _number(file: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _bad_line(file, line, f"{column} = {_shown(text)}", "give a finite number")
    return value


def _shown(text: str) -> str:
    """At most as much of a cell as fits a line, control characters escaped."""
    return repr(text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "...")


def _bad_line(file: Path, line: int, cause: str, cure: str) -> ConfigError:
    return ConfigError(f"path file {file}, line {line}: {cause}", cure)
