"""``ccr-host record``: measure a robot at rest in many poses, as a table for ``identify``.

Each pattern moves the motors within the range of the tour of controller `adaptive`, those of other
robots than the paper's as far as a segment bends by a right angle. Where motors could wind tendons
against each other, others pay out what the moved ones wind up. Rows are on disk as soon as they are
measured, so whatever ends a recording leaves what was measured until then.
"""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError, ConfigError, TrackerError, why
from ccr_host.core.user_file import keep_elsewhere
from ccr_host.description.robot import Robot
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rest_motion import OnPose, visit
from ccr_host.run.rig import Rig
from ccr_host.tools.measured import MIDDLE
from ccr_host.tools.survey import identification_stops_rad
from ccr_host.tracking.markers.check import MarkerCheck

_LEVELS = np.linspace(-1.0, 1.0, 9)
"""Levels of a staircase; its steps have to outnumber those that `hysteresis` takes for a sweep."""
_PAIR = 0.7
"""Amplitude of two motors at a time, so that the robot bends about as far as with one."""
_MOST_CORNERS = 16
_MOST_BENDING_RAD = 0.5 * np.pi
_SINES = 3
_TURNS_OF_SLOWEST = 2.0
_RANDOM_STREAM = 16
"""Keeps these poses independent of the random numbers of the simulated robot."""


def _staircase(motors: int, _: int, __: np.random.Generator) -> Array:
    """One motor after the other in steps to both ends, each step from both sides."""
    up, home = _LEVELS, len(_LEVELS) // 2
    way = np.concatenate([up[home::-1], up[1:], up[-2::-1], up[1 : home + 1]])
    return np.concatenate([np.outer(way, axis) for axis in np.eye(motors)])


def _single(motors: int, _: int, __: np.random.Generator) -> Array:
    """One motor after the other straight to an end and back home."""
    way = np.array([1.0, 0.0, -1.0, 0.0])
    return np.concatenate([np.outer(way, axis) for axis in np.eye(motors)])


def _pairs(motors: int, _: int, __: np.random.Generator) -> Array:
    """Two motors at a time through all combinations of their ends, and home."""
    corners = _PAIR * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (0, 0), (1, -1), (-1, 1)])
    corners = np.concatenate([corners, np.zeros((1, 2))])
    axes = np.eye(motors)
    pairs = [corners @ axes[list(two)] for two in itertools.combinations(range(motors), 2)]
    return np.concatenate([np.zeros((0, motors)), *pairs])


def _random(motors: int, rests: int, rng: np.random.Generator) -> Array:
    """Anywhere."""
    return rng.uniform(-1.0, 1.0, (rests, motors))


def _multisine(motors: int, rests: int, rng: np.random.Generator) -> Array:
    """All motors at once along sums of sines, each motor with frequencies of its own."""
    turns = _TURNS_OF_SLOWEST + np.arange(_SINES * motors).reshape(_SINES, motors)
    phase = rng.uniform(0.0, 2.0 * np.pi, (_SINES, motors))
    time = np.arange(rests)[:, None, None] / rests
    way: Array = np.sin(2.0 * np.pi * turns * time + phase).sum(axis=1)
    largest: Array = np.abs(way).max(axis=0)
    return way / largest


def _release(motors: int, _: int, rng: np.random.Generator) -> Array:
    """All motors from a corner home at once, which slackens tendons the most; from some of many."""
    corners = np.array(list(itertools.product((1.0, -1.0), repeat=motors)))
    if len(corners) > _MOST_CORNERS:
        corners = rng.permutation(corners)[:_MOST_CORNERS]
    way = np.stack([corners, np.zeros_like(corners)], axis=1)
    return _PAIR * way.reshape(-1, motors)


PATTERNS: dict[str, Callable[[int, int, np.random.Generator], Array]] = {
    "staircase": _staircase,
    "single": _single,
    "pairs": _pairs,
    "random": _random,
    "multisine": _multisine,
    "release": _release,
}
"""Stops of each pattern for a number of motors and of rests, (K, M) from -1 to 1.

`release` comes last: `identify` leaves it out, and so loses no move between other rests.
"""


@dataclass(frozen=True, eq=False)
class Stops:
    """Poses to measure, in their order."""

    pattern: list[str]
    """Name of each pose's pattern."""
    q_rad: Array
    """Motor angles, (K, M)."""


def stops_of(description: Description, names: Sequence[str], rests: int, seed: int) -> Stops:
    """The poses of some patterns, those of all if none is named.

    ``rests`` is the number of those of `random`, and of `multisine`; the order of ``names`` does
    not matter.

    Raises:
        ConfigError: unknown pattern.
    """
    for name in names:
        if name not in PATTERNS:
            raise ConfigError(f"--pattern {name}: unknown", f"one of {', '.join(PATTERNS)}")
    low, high = _range_rad(description)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_RANDOM_STREAM,)))
    # All are drawn, so that a pattern does not depend on which others are wanted.
    shares = {name: stops(len(low), rests, rng) for name, stops in PATTERNS.items()}
    wanted = [name for name in PATTERNS if name in names or not names]
    share = np.concatenate([shares[name] for name in wanted])
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    q_rad = limits.without_pretension(model, np.where(share < 0.0, -low, high) * share)
    return Stops([name for name in wanted for _ in shares[name]], q_rad + 0.0)  # 0.0: no -0


def _range_rad(description: Description) -> tuple[Array, Array]:
    """How far each motor is moved in both directions, (M,) each, rad."""
    if not description.robot.segments:
        tour_rad = identification_stops_rad(description)
        return np.minimum(tour_rad.min(axis=0), 0.0), np.maximum(tour_rad.max(axis=0), 0.0)
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    bends = model.bends_rad(model.bending_rad(np.eye(model.motors)))
    reach_rad = _MOST_BENDING_RAD / np.linalg.norm(bends, axis=-1).max(axis=-1)
    low, high = np.maximum(limits.lower_rad, -reach_rad), np.minimum(limits.upper_rad, reach_rad)
    return np.minimum(low, 0.0), np.maximum(high, 0.0)


class RestTable:
    """A table of rests that is on disk up to the last row; see `new_table`.

    Raises:
        CcrError: the file cannot be written.
    """

    def __init__(self, file: Path, stream: TextIO, robot: Robot) -> None:
        self.rests = 0
        self._file = file
        self._stream = stream
        self._rows: list[Sequence[str]] = []
        between = [name.lower() for name in robot.markers[1:-1]]
        markers = ["tip", *(between if len(between) != 1 else [MIDDLE])]
        marks = [f"{marker}_{axis}_mm" for marker in markers for axis in "xyz"]
        angles = [f"q{motor}_deg" for motor in range(1, robot.motors + 1)]
        self._write(["t_s", "pattern", *angles, *marks, "count"])

    def add(self, time_us: int, pattern: str, q_rad: Array, markers_mm: Array) -> None:
        """Write one rest: motor angles, (M,), and markers of all exposures, (n, S + 1, 3).

        Raises:
            CcrError: the file cannot be written.
        """
        first_mm, *between_mm, tip_mm = markers_mm.mean(axis=0)
        vectors_mm = np.concatenate([place - first_mm for place in (tip_mm, *between_mm)])
        self._write(
            [
                f"{time_us * 1e-6:.3f}",
                pattern,
                *(f"{angle:.4f}" for angle in np.degrees(q_rad)),
                *(f"{mm:.4f}" for mm in vectors_mm),
                str(len(markers_mm)),
            ]
        )
        self.rests += 1

    def settled(self) -> Path:
        """The file that holds all rows.

        Raises:
            CcrError: it was removed and cannot be written again.
        """
        if self.rests and not self._is_there():
            self._begin_again()
        return self._file

    def close(self) -> None:
        with suppress(OSError):
            self._stream.close()

    def _write(self, cells: Sequence[str]) -> None:
        self._rows.append(cells)
        if self.rests and not self._is_there():
            self._begin_again()
            return
        try:
            self._put([cells])
        except OSError as error:
            raise CcrError(
                f"{self._file}: {why(error)}", "free disk space; the rows before are kept"
            ) from None

    def _put(self, rows: Sequence[Sequence[str]]) -> None:
        csv.writer(self._stream, lineterminator="\n").writerows(rows)
        self._stream.flush()

    def _is_there(self) -> bool:
        """Whether the file has still its name; someone may have removed or replaced it."""
        try:
            return os.path.samestat(self._file.stat(), os.fstat(self._stream.fileno()))
        except OSError:
            return False

    def _begin_again(self) -> None:
        """Write all rows to a file of the same name, or to a temporary one.

        Raises:
            CcrError: says where the rows are.
        """
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._stream.close()
            self._stream = self._file.open("x", encoding="utf-8", newline="")
            self._put(self._rows)
        except OSError as error:
            cause = f"{self._file}: {why(error)}"
            try:
                self._file = keep_elsewhere("", ".csv")
                self._stream = self._file.open("a", encoding="utf-8", newline="")
                self._put(self._rows)
            except OSError:
                raise CcrError(cause, "free disk space; the rows are lost") from None
            self.rests = len(self._rows) - 1  # with the one that was to be added
            raise CcrError(cause, f"the rows until now are in {self._file}") from None


@contextmanager
def new_table(file: Path, robot: Robot) -> Iterator[RestTable]:
    """Create a table; it is removed if it gets no row, whatever happens.

    Raises:
        ConfigError: the file exists or cannot be created.
        CcrError: it cannot be written.
    """
    try:
        opened = file.open("x", encoding="utf-8", newline="")
    except FileExistsError:
        raise ConfigError(f"{file} exists", "name a new file, or move the old one away") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{file}: {why(error)}", "name a file that can be created") from None
    table = None
    try:
        table = RestTable(file, opened, robot)
        yield table
    finally:
        with suppress(OSError):  # a row that could not be written is still in the buffer
            opened.close()
        if table is not None and table.rests:
            table.close()
        else:
            file.unlink(missing_ok=True)


def record_rests(
    rig: Rig, description: Description, stops: Stops, table: RestTable, on_pose: OnPose
) -> None:
    """Arm the robot, measure at each stop, disarm. Stops without markers are left out.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: no markers in any pose, or not those of this robot.
        RestError: the robot does not come to rest.
        CcrError: the table cannot be written.
    """
    start_us = rig.clock.now_us()

    def keep(number: int, markers_mm: Array) -> None:
        time_us = rig.clock.now_us() - start_us
        table.add(time_us, stops.pattern[number], stops.q_rad[number], markers_mm)

    visit(rig, MarkerCheck(description), stops.q_rad, on_pose, keep)
    if not table.rests:
        raise TrackerError(
            f"no markers from {rig.tracker.name} in any pose",
            "check line of sight and the camera's measurement volume; see ccr-host monitor",
        )
