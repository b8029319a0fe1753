"""Width of the hysteresis and repeatability, from measurements alone, without a model."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.tools.measured import Measured

FloatArray = NDArray[np.float64]

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


def _runs(measured: Measured) -> list[NDArray[np.intp]]:
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


def _sweep(measured: Measured, there: NDArray[np.intp], back: NDArray[np.intp]) -> Sweep | None:
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


def _interpolated(at: FloatArray, along: FloatArray, tip_mm: FloatArray) -> FloatArray:
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
