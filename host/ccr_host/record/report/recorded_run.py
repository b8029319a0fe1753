"""A run as its folder tells it, finished or not."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ccr_host.control.base import Phase
from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import read_text
from ccr_host.record.folder import METRICS_FILE
from ccr_host.record.log.play import play_run
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.schemas import NUMBER, OBJECT, TEXT, array, nullable, record, validator
from ccr_host.run.observer import (
    RunObserver,
    RunSetup,
    StepRecord,
    measured_errors_mm,
    true_errors_mm,
)
from ccr_host.run.summary import ErrorFigures

_MOST_BYTES = 4_000_000
_FIGURES = (
    *("mean_error_mm", "p95_error_mm", "max_error_mm", "true_mean_error_mm"),
    *("twin_floor_mean_error_mm", "tracker_lost_steps", "missed_deadlines"),
)
_METRICS = validator(
    record(
        "metrics",
        **dict.fromkeys(_FIGURES, nullable(NUMBER)),
        faults=array(TEXT),
        link=nullable(OBJECT),
    )
)
"""What the page uses of them."""


@dataclass(frozen=True)
class RecordedRun:
    """What a report is made from."""

    folder: Path
    setup: RunSetup
    records: Sequence[StepRecord]
    events: Sequence[tuple[float, str]]
    """Time on the run's clock, s, and what happened."""
    metrics: Mapping[str, Any]
    """Summary of the run; of a run that was killed, the error figures alone."""
    versions: Mapping[str, str]
    log_trouble: str
    """What is missing in the log; empty if nothing is."""

    @property
    def title(self) -> str:
        """For people."""
        options = self.setup.options
        return f"{self.setup.reference.name}, {options.controller}, {options.rate_hz:g} Hz"


def read_run(folder: Path) -> RecordedRun:
    """Read log and summary.

    Raises:
        ConfigError: no log of a run is there.
    """
    seen = _Seen()
    play_run(folder, seen)
    if seen.setup is None:
        raise ConfigError(f"{folder}: not the log of a run", "give the folder of a run")
    recording = RunRecording(folder)
    return RecordedRun(
        folder=folder,
        setup=seen.setup,
        records=seen.records,
        events=seen.events,
        metrics=_kept_metrics(folder) or _error_figures(seen.records),
        versions=recording.setup["versions"],
        log_trouble=recording.end.trouble,
    )


class _Seen(RunObserver):
    def __init__(self) -> None:
        self.setup: RunSetup | None = None
        self.records: list[StepRecord] = []
        self.events: list[tuple[float, str]] = []

    def begin(self, setup: RunSetup) -> None:
        self.setup = setup

    def step(self, record: StepRecord) -> None:
        self.records.append(record)

    def event(self, time_us: int, text: str) -> None:
        self.events.append((time_us * 1e-6, text))

    def phase(self, time_us: int, phase: Phase) -> None:
        self.event(time_us, phase.name)


def _kept_metrics(folder: Path) -> Mapping[str, Any] | None:
    """None where there is no such file, or not one of ours."""
    try:
        text, _ = read_text(folder / METRICS_FILE, "summary", "", _MOST_BYTES)
        metrics: Mapping[str, Any] = json.loads(text)["metrics"]
    except (ConfigError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return metrics if _METRICS.isinstance_python(metrics) else None


def _error_figures(records: Sequence[StepRecord]) -> Mapping[str, Any]:
    measured = ErrorFigures.of(measured_errors_mm(records))
    figures: dict[str, Any] = {} if measured is None else {**measured.as_summary()}
    truth = true_errors_mm(records)
    true_figures = None if truth is None else ErrorFigures.of(truth)
    return figures if true_figures is None else figures | true_figures.as_summary("true_")
