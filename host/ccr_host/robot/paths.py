"""Desired paths: the paper's three (16)-(18), and files.

A path prescribes two lateral coordinates: its y is f[0] of (10), its z is f[2]. The third,
along the robot, follows from (10) at the nearest reachable configuration, unless a file gives it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import is_there, printable
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.path_file import SampledPath, read_path_file
from ccr_host.robot.reference import MAX_SAMPLES, Reference
from ccr_host.robot.workspace import MotorLimits, Workspace

__all__ = ["MAX_SAMPLES", "Reference", "load_path", "path_names"]

FloatArray = NDArray[np.float64]

MIN_SAMPLES = 2
MIN_RATE_HZ = 0.1
"""The board's protocol supports ramps of up to 10 s."""
MAX_RATE_HZ = 1000.0
"""20 targets per servo pulse; the link carries about 1500 per second at most."""
_LONGEST_TITLE = 60


@dataclass(frozen=True)
class _Shape:
    duration_s: float
    lateral_mm: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    """Map times, s, to path y and z, mm."""


def _ellipse(t: FloatArray) -> tuple[FloatArray, FloatArray]:
    phase = math.pi * t / 40.0
    return 35.0 * np.cos(phase), 45.0 * np.sin(phase)


def _eight(t: FloatArray) -> tuple[FloatArray, FloatArray]:
    sine, cosine = np.sin(math.pi * t / 40.0), np.cos(math.pi * t / 40.0)
    z = 48.0 * np.sign(cosine) * cosine**2
    return z * sine, z


def _star(t: FloatArray) -> tuple[FloatArray, FloatArray]:
    fast, slow = math.pi * t / 10.0, math.pi * t / 25.0
    return 25.0 * (0.4 * np.sin(fast) - np.sin(slow)), 25.0 * (0.4 * np.cos(fast) + np.cos(slow))


_SHAPES = {
    "ellipse": _Shape(80.0, _ellipse),
    "8shape": _Shape(80.0, _eight),
    "star": _Shape(100.0, _star),
}


def path_names() -> list[str]:
    """The built-in paths."""
    return list(_SHAPES)


def load_path(
    name_or_file: str, rate_hz: float, model: ConstantCurvature, limits: MotorLimits
) -> Reference:
    """Sample a built-in path, or a file, at the control rate.

    Args:
        name_or_file: one of ``path_names()`` or a file, see `path_file`.
        rate_hz: control rate.
        model: the controller's model of the robot.
        limits: limits of the motor angles.

    Raises:
        ConfigError: unknown name, unusable file, or a rate that gives no sensible path.
    """
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise ConfigError(
            f"rate {rate_hz:g} Hz: outside {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}",
            "give e.g. --rate 1",
        )
    if name_or_file in _SHAPES:
        shape = _SHAPES[name_or_file]
        time_s = _clock(name_or_file, shape.duration_s * rate_hz, rate_hz)
        y, z = shape.lateral_mm(time_s)
        return _reference(name_or_file, rate_hz, SampledPath(time_s, y, z, None), model, limits)
    rows = read_path_file(_existing_file(name_or_file))
    duration_s = float(rows.time_s[-1]) - float(rows.time_s[0])
    # A file includes both ends, so the last row is a sample too.
    time_s = _clock(name_or_file, duration_s * rate_hz + 1.0, rate_hz)
    name = _title(Path(name_or_file))
    return _reference(name, rate_hz, rows.resampled(time_s), model, limits)


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


def _clock(name: str, samples: float, rate_hz: float) -> FloatArray:
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


def _reference(
    name: str, rate_hz: float, path: SampledPath, model: ConstantCurvature, limits: MotorLimits
) -> Reference:
    nearest = Workspace(model, limits).nearest(np.stack([path.y_mm, path.z_mm], axis=-1))
    along = model.tip_mm(nearest.q_rad)[:, 1] if path.x_mm is None else path.x_mm
    return Reference(
        name=name,
        period_s=1.0 / rate_hz,
        time_s=path.time_s,
        target_mm=np.stack([path.y_mm, along, path.z_mm], axis=-1),
        q_rad=nearest.q_rad,
        unavoidable_mm=nearest.distance_mm,
    )
