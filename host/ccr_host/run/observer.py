"""What can be seen of a run while it happens: the log, the live page and whoever else looks on.

Nothing in it comes from the wall clock but ``StepRecord.solve_us``, so that in virtual time equal
seeds give equal logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Observation, Outcome, Phase
from ccr_host.description.schema import Description
from ccr_host.link.messages import StateReport
from ccr_host.robot.reference import Reference
from ccr_host.tracking.tracker import MarkerFrame, Sample

if TYPE_CHECKING:
    from ccr_host.run.options import RunOptions
    from ccr_host.run.tape import TapePiece

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class StepRecord:
    """One control period, judged at its end: the command of step i aims at f_i.

    ``measured_mm`` and ``true_mm`` are f = M3 - M1 (3,) at the end of the period; None where the
    tracker has lost the markers, or where nobody knows the truth (hardware).
    """

    step: int
    end_us: int
    """Of the period, on the run's clock."""
    time_s: float
    """Of the step, on the path's clock."""
    target_mm: Vector
    q_rad: Vector
    outcome: Outcome
    detail: str
    predicted_mm: Vector
    solve_us: float
    late: bool
    measured_mm: Vector | None
    measured_age_us: int | None
    true_mm: Vector | None


def measured_errors_mm(records: Sequence[StepRecord]) -> Vector:
    """f_m - f, (N, 3); NaN rows where nothing was measured."""
    return _errors(records, [record.measured_mm for record in records])


def true_errors_mm(records: Sequence[StepRecord]) -> Vector | None:
    """True tip minus desired one, (N, 3); NaN rows of skipped steps, None without a twin."""
    positions = [record.true_mm for record in records]
    is_real = bool(positions) and all(position is None for position in positions)
    return None if is_real else _errors(records, positions)


def _errors(records: Sequence[StepRecord], positions: Sequence[Vector | None]) -> Vector:
    unknown = np.full(3, np.nan)
    rows = [
        (unknown if position is None else position) - record.target_mm
        for record, position in zip(records, positions, strict=True)
    ]
    return np.array(rows).reshape(-1, 3)


@dataclass(frozen=True)
class RunSetup:
    """All that is settled before a run begins."""

    options: RunOptions
    description: Description
    reference: Reference


class RunObserver:
    """Looks on in the control loop's own thread: returns at once and never raises.

    To be inherited from: whoever looks on overrides what it wants to see.
    """

    def begin(self, setup: RunSetup) -> None:
        """Before anything else."""

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        """Bytes of one frame on the link, as sent (``sent``) or received (``received``)."""

    def state(self, time_us: int, report: StateReport) -> None:
        """A report of the board's state."""

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        """What a camera has delivered, before its markers are labelled."""

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        """A sample that has arrived, whether or not the control loop will use it."""

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        """What the controller was told and what it answered; no observation at its start."""

    def step(self, record: StepRecord) -> None:
        """The end of one control period."""

    def event(self, time_us: int, text: str) -> None:
        """Something worth knowing afterwards: faults, interruptions, what the board does alone."""

    def phase(self, time_us: int, phase: Phase) -> None:
        """What the run is doing from now on, or how much of that is done."""

    def inputs(self, piece: TapePiece) -> None:
        """The next piece of all that has come to the host from outside."""


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
