"""The events of a run while it happens, for the log, the live page and other subscribers.

Only ``StepRecord.solve_us`` comes from the wall clock, so in virtual time equal seeds give equal
logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.control.base import Command, Observation, Outcome, Phase
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.link.messages import StateReport
from ccr_host.robot.reference import Reference
from ccr_host.tracking.tracker import MarkerFrame, Sample

if TYPE_CHECKING:
    from ccr_host.run.options import RunOptions
    from ccr_host.run.recording import TapePiece


@dataclass(frozen=True)
class StepRecord:
    """A control period, evaluated at its end: the command of step i aims at f_i.

    ``measured_mm`` and ``true_mm`` are f = M3 - M1 (3,) at the end of the period; None if the
    tracker has lost the markers, or if the truth is unknown (hardware).
    """

    step: int
    end_us: int
    """End of the period, on the run's clock."""
    time_s: float
    """Time of the step, on the path's clock."""
    target_mm: Array
    q_rad: Array
    outcome: Outcome
    detail: str
    predicted_mm: Array
    solve_us: float
    late: bool
    measured_mm: Array | None
    measured_age_us: int | None
    true_mm: Array | None


def measured_errors_mm(records: Sequence[StepRecord]) -> Array:
    """f_m - f, (N, 3), with NaN rows for steps without a measurement."""
    return _errors(records, [record.measured_mm for record in records])


def true_errors_mm(records: Sequence[StepRecord]) -> Array | None:
    """True minus desired tip, (N, 3), with NaN rows for skipped steps; None without a twin."""
    positions = [record.true_mm for record in records]
    is_real = bool(positions) and all(position is None for position in positions)
    return None if is_real else _errors(records, positions)


def _errors(records: Sequence[StepRecord], positions: Sequence[Array | None]) -> Array:
    unknown = np.full(3, np.nan)
    rows = [
        (unknown if position is None else position) - record.target_mm
        for record, position in zip(records, positions, strict=True)
    ]
    return np.array(rows).reshape(-1, 3)


@dataclass(frozen=True)
class RunSetup:
    """What is fixed before a run begins."""

    options: RunOptions
    description: Description
    reference: Reference


class RunObserver:
    """Base class of observers, which override the events they need.

    They are called in the control loop's thread: each method must return at once and never raise.
    """

    def begin(self, setup: RunSetup) -> None:
        """Called first."""

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        """The bytes of a frame on the link; the direction is ``sent`` or ``received``."""

    def state(self, time_us: int, report: StateReport) -> None:
        """A report of the board's state."""

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        """A frame of the camera, before its markers are labelled."""

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        """A sample that has arrived, whether or not the control loop uses it."""

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        """The controller's observation, None at its start, and its command."""

    def step(self, record: StepRecord) -> None:
        """A control period has ended."""

    def event(self, time_us: int, text: str) -> None:
        """A remark for the log: a fault, an interruption, an action of the board."""

    def phase(self, time_us: int, phase: Phase) -> None:
        """What the run does from now on, or the progress of it."""

    def inputs(self, piece: TapePiece) -> None:
        """The next piece of the tape of all inputs of the host."""


class Observers(RunObserver):
    """Several observers as one."""

    def __init__(self, observers: Sequence[RunObserver] = ()) -> None:
        self._observers = tuple(observers)

    def begin(self, setup: RunSetup) -> None:
        for observer in self._observers:
            observer.begin(setup)

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        for observer in self._observers:
            observer.frame(direction, time_us, data)

    def state(self, time_us: int, report: StateReport) -> None:
        for observer in self._observers:
            observer.state(time_us, report)

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        for observer in self._observers:
            observer.marker_frame(time_us, frame)

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        for observer in self._observers:
            observer.tracker_sample(time_us, sample)

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        for observer in self._observers:
            observer.control(time_us, observation, command)

    def step(self, record: StepRecord) -> None:
        for observer in self._observers:
            observer.step(record)

    def event(self, time_us: int, text: str) -> None:
        for observer in self._observers:
            observer.event(time_us, text)

    def phase(self, time_us: int, phase: Phase) -> None:
        for observer in self._observers:
            observer.phase(time_us, phase)

    def inputs(self, piece: TapePiece) -> None:
        for observer in self._observers:
            observer.inputs(piece)
