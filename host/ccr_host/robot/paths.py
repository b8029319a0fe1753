"""Desired paths: the paper's three (16)-(18), some in space for robots of any size, and files.

A path prescribes two lateral coordinates: its y is f[0] of (10), its z is f[2]. The third, x along
the robot, is f[1]; it follows from the robot's surface at the nearest reachable configuration
unless the path prescribes it too. The paths in space are in parts of the robot's length, which they
take to reach along -x when it is straight. Files are tables of time, y, z and optionally x, in any
order, each with its unit.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.core.text_table import UNIT, TextTable, in_ascii, is_number, shown
from ccr_host.core.user_file import is_there, printable
from ccr_host.robot.reference import MAX_SAMPLES, Reference
from ccr_host.robot.workspace import Surface

__all__ = ["MAX_SAMPLES", "PAPER_PATHS", "Reference", "load_path", "path_names", "sample_path"]


MIN_SAMPLES = 2
MIN_RATE_HZ = 0.1
"""The board's protocol supports ramps of up to 10 s."""
MAX_RATE_HZ = 1000.0
"""20 targets per servo pulse; the link carries about 1500 per second at most."""
_LONGEST_TITLE = 60


_Line = tuple[Array, Array, Array | None]
"""y, z and x of the samples, mm; x may be left to the robot."""


@dataclass(frozen=True)
class _Shape:
    duration_s: float
    line_mm: Callable[[Array, float], _Line]
    """The line at times, s, for a robot of some length, mm."""


def _ellipse(t: Array, _: float) -> _Line:
    phase = math.pi * t / 40.0
    return 35.0 * np.cos(phase), 45.0 * np.sin(phase), None


def _eight(t: Array, _: float) -> _Line:
    sine, cosine = np.sin(math.pi * t / 40.0), np.cos(math.pi * t / 40.0)
    z = 48.0 * np.sign(cosine) * cosine**2
    return z * sine, z, None


def _star(t: Array, _: float) -> _Line:
    fast, slow = math.pi * t / 10.0, math.pi * t / 25.0
    y, z = 0.4 * np.sin(fast) - np.sin(slow), 0.4 * np.cos(fast) + np.cos(slow)
    return 25.0 * y, 25.0 * z, None


def _swing(t: Array, length_mm: float) -> _Line:
    """Swings to and fro in the plane of one segment."""
    return np.zeros_like(t), 0.3 * length_mm * np.sin(math.pi * t / 20.0), None


def _circle(t: Array, length_mm: float) -> _Line:
    phase = math.pi * t / 40.0
    radius_mm = 0.3 * length_mm
    return radius_mm * np.cos(phase), radius_mm * np.sin(phase), np.full_like(t, -0.85 * length_mm)


def _helix(t: Array, length_mm: float) -> _Line:
    """Three turns, towards the base and back to the first point."""
    phase = math.pi * t / 40.0
    radius_mm = 0.25 * length_mm
    along_mm = (-0.8 - 0.1 * np.cos(phase)) * length_mm
    return radius_mm * np.cos(3.0 * phase), radius_mm * np.sin(3.0 * phase), along_mm


def _dome_eight(t: Array, length_mm: float) -> _Line:
    """A figure of eight on the dome that the tip of one arc of constant curvature reaches."""
    phase = math.pi * t / 40.0
    bend_rad = np.sin(phase)
    way_rad = 0.5 * np.cos(phase)
    aside_mm = length_mm * bend_rad * 0.5 * np.sinc(bend_rad / (2.0 * math.pi)) ** 2
    along_mm = -length_mm * np.sinc(bend_rad / math.pi)
    return aside_mm * np.cos(way_rad), aside_mm * np.sin(way_rad), along_mm


_PEN = (
    (-0.1, 0.8), (-0.3, 1.0), (-0.7, 1.0), (-0.9, 0.8), (-0.9, 0.2), (-0.7, 0.0), (-0.3, 0.0),
    (-0.1, 0.2), (0.1, 0.0), (0.1, 1.0), (0.6, 1.0), (0.8, 0.8), (0.8, 0.7), (0.6, 0.5), (0.1, 0.5),
    (0.5, 0.5), (0.8, 0.0), (-0.1, 0.8),
)  # fmt: skip
"""C and R, drawn without lifting the pen, and the way back; widths and heights."""


def _letters(t: Array, length_mm: float) -> _Line:
    """Two letters at constant speed, in a plane across the robot."""
    corners = np.array(_PEN)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    y, z = (np.interp(t / 100.0 * way[-1], way, column) for column in corners.T)
    size_mm = 0.3 * length_mm
    return size_mm * y, size_mm * (z - 0.5), np.full_like(t, -0.85 * length_mm)


PAPER_PATHS = ("ellipse", "8shape", "star")
"""Those with published results; lateral, for the paper's robot."""
_SHAPES = {
    "ellipse": _Shape(80.0, _ellipse),
    "8shape": _Shape(80.0, _eight),
    "star": _Shape(100.0, _star),
    "swing": _Shape(80.0, _swing),
    "circle": _Shape(80.0, _circle),
    "helix": _Shape(80.0, _helix),
    "dome8": _Shape(80.0, _dome_eight),
    "letters": _Shape(100.0, _letters),
}


def path_names() -> list[str]:
    """The built-in paths."""
    return list(_SHAPES)


def load_path(name_or_file: str, rate_hz: float, surface: Surface) -> Reference:
    """Sample a path and project it onto what a robot reaches.

    ``name_or_file`` is one of ``path_names()`` or a file, see `read_path_file`.

    Raises:
        ConfigError: unknown name, unusable file, or a rate that gives no sensible path.
    """
    path = sample_path(name_or_file, rate_hz, surface.length_mm)
    name = name_or_file if name_or_file in _SHAPES else _title(Path(name_or_file))
    return _reference(name, rate_hz, path, surface)


def sample_path(name_or_file: str, rate_hz: float, length_mm: float) -> SampledPath:
    """Sample a built-in path, or a file, at the control rate.

    ``length_mm`` is the length of the robot, to which paths in space are scaled.

    Raises:
        ConfigError: see `load_path`.
    """
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ConfigError(
            f"rate {rate_hz:g} Hz: outside {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}",
            "give e.g. --rate 1",
        )
    if name_or_file in _SHAPES:
        shape = _SHAPES[name_or_file]
        time_s = _clock(name_or_file, shape.duration_s * rate_hz, rate_hz)
        return SampledPath(time_s, *shape.line_mm(time_s, length_mm))
    rows = read_path_file(_existing_file(name_or_file))
    duration_s = float(rows.time_s[-1]) - float(rows.time_s[0])
    # A file includes both ends, so the last row is a sample too.
    return rows.resampled(_clock(name_or_file, duration_s * rate_hz + 1.0, rate_hz))


def _title(file: Path) -> str:
    """A short, printable name, different from the built-in paths, which have published results."""
    name = file.stem if file.stem not in _SHAPES else f"{file.stem} (file)"
    return printable(name, _LONGEST_TITLE)


def _existing_file(name_or_file: str) -> Path:
    file = Path(name_or_file)
    looks_like_file = file.suffix != "" or len(file.parts) > 1 or is_there(file)
    if not looks_like_file:
        raise ConfigError(
            f"unknown path {name_or_file}",
            f"give one of {', '.join(path_names())}, or a CSV file",
        )
    return file


def _clock(name: str, samples: float, rate_hz: float) -> Array:
    """Sample times from 0, s; the tolerance absorbs rounding just below a whole count."""
    count = math.floor(samples + 1e-6) if samples < 2 * MAX_SAMPLES else MAX_SAMPLES + 1
    if count > MAX_SAMPLES:
        raise ConfigError(
            f"path {name} at {rate_hz:g} Hz has more than {MAX_SAMPLES} samples",
            "lower --rate or shorten the path",
        )
    if count < MIN_SAMPLES:
        raise ConfigError(
            f"path {name} at {rate_hz:g} Hz has fewer than {MIN_SAMPLES} samples",
            "raise --rate or lengthen the path",
        )
    return np.arange(count) / rate_hz


def _reference(name: str, rate_hz: float, path: SampledPath, surface: Surface) -> Reference:
    lateral = [path.y_mm, path.z_mm]
    given = lateral if path.x_mm is None else [path.y_mm, path.x_mm, path.z_mm]
    nearest = surface.along(np.stack(given, axis=-1))
    along = nearest.tip_mm[:, 1] if path.x_mm is None else path.x_mm
    return Reference(
        name=name,
        period_s=1.0 / rate_hz,
        time_s=path.time_s,
        target_mm=np.stack([path.y_mm, along, path.z_mm], axis=-1),
        q_rad=nearest.q_rad,
        unavoidable_mm=nearest.distance_mm,
        in_space=path.x_mm is not None,
    )


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

    time_s: Array
    y_mm: Array
    z_mm: Array
    x_mm: Array | None

    def resampled(self, time_s: Array) -> SampledPath:
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


def _read(table: TextTable[_Columns]) -> dict[str, Array]:
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


def _require_plausible_units(file: Path, header: _Columns, table: dict[str, Array]) -> None:
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
