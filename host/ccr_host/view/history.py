"""All that the page knows of a run, and how it stood at any time of it.

The live page and the player fill the same history, so whatever can be seen live can be scrubbed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ccr_host.control.base import Command, Observation, Phase
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.tracking.tracker import Sample
from ccr_host.view.growing import FloatArray, GrowingTable
from ccr_host.view.link_history import BoardState, LinkHealth, LinkHistory


class StepColumns(NamedTuple):
    """One row a control step."""

    end_us: FloatArray
    error_mm: FloatArray
    """|f_m - f|; NaN where nothing was measured."""
    true_error_mm: FloatArray
    """NaN without a twin."""
    unavoidable_mm: FloatArray
    """What the model says cannot be reached."""
    solve_us: FloatArray
    age_us: FloatArray
    """Of the sample; NaN where the markers were lost."""
    late: FloatArray
    """1 where the command came too late."""


@dataclass(frozen=True)
class Moment:
    """A run at one time of it."""

    time_us: float
    phase: Phase | None
    """What the run was doing."""
    record: StepRecord | None
    """The last step that has ended."""
    horizon_mm: FloatArray
    """(k, 3): where the newest command expects the tip, from the end of its period on."""
    markers_mm: FloatArray | None
    """(3, 3), newest whole sample, M1 is the origin; None where it is too old to be believed."""
    markers_age_us: float
    """Since that sample came; NaN before the first."""
    board: BoardState | None
    link: LinkHealth | None
    steps: StepColumns
    trail_mm: FloatArray
    """(n, 3): measured tip at the end of each step; NaN where it was not measured."""


class RunHistory(RunObserver):
    """An observer that keeps what it sees."""

    def __init__(self) -> None:
        self.setup: RunSetup | None = None
        self.link = LinkHistory()
        self._steps = GrowingTable(len(StepColumns._fields))
        self._trail = GrowingTable(4)
        self._records: list[StepRecord] = []
        self._command_us = GrowingTable(1)
        self._horizons_mm: list[FloatArray] = []
        self._samples = GrowingTable(10)
        self._phases: list[tuple[int, Phase]] = []
        self._stale_us = math.inf
        self.end_us = 0

    def begin(self, setup: RunSetup) -> None:
        self.setup = setup
        self._stale_us = setup.description.control.stale_after_ms * 1000.0

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        self.link.frame(direction, time_us, data)
        self.end_us = max(self.end_us, time_us)

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        relative_mm = sample.markers_mm - sample.markers_mm[0]
        if np.isfinite(relative_mm).all():
            self._samples.append((time_us, *relative_mm.ravel()))
        self.end_us = max(self.end_us, time_us)

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        self._command_us.append((time_us,))
        self._horizons_mm.append(command.predicted_mm)

    def step(self, record: StepRecord) -> None:
        measured_mm = _or_nan(record.measured_mm)
        self._records.append(record)
        self._trail.append((record.end_us, *measured_mm))
        self._steps.append(
            (  # in the order of StepColumns
                record.end_us,
                float(np.linalg.norm(measured_mm - record.target_mm)),
                float(np.linalg.norm(_or_nan(record.true_mm) - record.target_mm)),
                self._unavoidable_mm(record.step),
                record.solve_us,
                math.nan if record.measured_age_us is None else record.measured_age_us,
                record.late,
            )
        )
        self.end_us = max(self.end_us, record.end_us)

    def event(self, time_us: int, text: str) -> None:
        self.end_us = max(self.end_us, time_us)

    def phase(self, time_us: int, phase: Phase) -> None:
        self._phases.append((time_us, phase))
        self.end_us = max(self.end_us, time_us)

    def at(self, time_us: float) -> Moment:
        """The run at a time; everything later is left out."""
        steps = self._steps.until(time_us)
        samples = self._samples.until(time_us)
        age_us = time_us - samples[-1, 0] if len(samples) else math.nan
        commands = len(self._command_us.until(time_us))
        return Moment(
            time_us=time_us,
            phase=next((one for at_us, one in reversed(self._phases) if at_us <= time_us), None),
            record=self._records[len(steps) - 1] if len(steps) else None,
            horizon_mm=self._horizons_mm[commands - 1] if commands else np.empty((0, 3)),
            markers_mm=samples[-1, 1:].reshape(3, 3) if age_us <= self._stale_us else None,
            markers_age_us=age_us,
            board=self.link.board_at(time_us),
            link=self.link.health_at(time_us),
            steps=StepColumns(*steps.T),
            trail_mm=self._trail.until(time_us)[:, 1:],
        )

    def _unavoidable_mm(self, step: int) -> float:
        if self.setup is None or step >= len(self.setup.reference):
            return math.nan
        return float(self.setup.reference.unavoidable_mm[step])


def _or_nan(position_mm: FloatArray | None) -> FloatArray:
    return np.full(3, np.nan) if position_mm is None else position_mm
