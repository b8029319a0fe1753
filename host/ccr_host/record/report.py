"""Turns recorded runs, finished or not, into one page that needs no other file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, Undefined

from ccr_host.control.base import Phase
from ccr_host.core.errors import ConfigError, why
from ccr_host.core.user_file import read_text, replacing
from ccr_host.record.comparisons import why_measured_differs
from ccr_host.record.figure import PlottedRun, run_figure, shade_lost_spans
from ccr_host.record.figure_style import LIMIT, MOTORS, svg_element
from ccr_host.record.folder import METRICS_FILE
from ccr_host.record.log.reader import RunRecording, play_run
from ccr_host.record.log.topics import NUMBER, OBJECT, TEXT, array, nullable, record, validator
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.run.summary import error_figures, ratio_to_twin_floor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DASH = "-"
_MOST_BYTES = 4_000_000
_LEGEND_ROWS = 4
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
"""The metrics that the page uses."""


@dataclass(frozen=True)
class RecordedRun:
    """Everything a report shows of one run."""

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
        options = self.setup.options
        drive = f"{options.controller}, {options.rate_hz:g} Hz"
        return f"{self.setup.reference.name}, {drive}{options.on_surface}"


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
        metrics=_kept_metrics(folder) or error_figures(seen.records),
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


def overlay_svgs(runs: Sequence[RecordedRun], names: Sequence[str]) -> Iterator[str]:
    """All runs on one path in one figure, for each path that has several; a name for each run."""
    on_paths: dict[tuple[str, str], list[PlottedRun]] = {}
    for run, name in zip(runs, names, strict=True):
        if run.records:
            path = run.setup.reference.name, run.setup.options.surface
            on_paths.setdefault(path, []).append(_plotted(run, name))
    for together in on_paths.values():
        if len(together) > 1:
            yield svg_element(run_figure(together))


def health_svg(run: RecordedRun) -> str:
    """Motor angles against their limits, computing time and age of the samples."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    figure = Figure(figsize=(11, 7), layout="constrained")
    motors, solve, age = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    time_s = [record.time_s for record in run.records]
    _draw_motors(motors, run, time_s)
    solve.plot(time_s, [record.solve_us / 1000 for record in run.records], color=MOTORS[0])
    solve.set_ylabel("computing time (ms)")
    ages_ms = [
        np.nan if r.measured_age_us is None else r.measured_age_us / 1e3 for r in run.records
    ]
    age.plot(time_s, ages_ms, color=MOTORS[0])
    age.set_ylabel("age of the sample (ms)")
    age.set_xlabel("time (s)")
    for axes in (solve, age):
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    shade_lost_spans(age, _plotted(run))
    return svg_element(figure)


def _draw_motors(axes: Axes, run: RecordedRun, time_s: list[float]) -> None:
    angles_deg = np.degrees([record.q_rad for record in run.records])
    servo = run.setup.description.servo
    for axis, colour in enumerate(MOTORS[: angles_deg.shape[1]]):
        axes.plot(time_s, angles_deg[:, axis], color=colour, label=f"motor {axis + 1}")
        for limit in (servo.angle_min_deg[axis], servo.angle_max_deg[axis]):
            axes.axhline(limit, color=LIMIT, lw=0.8, ls=":")
    axes.set_ylabel("command (deg), limits dotted")
    axes.legend(loc="upper right", ncols=-(-angles_deg.shape[1] // _LEGEND_ROWS))
    axes.grid(alpha=0.3)


def _plotted(run: RecordedRun, label: str = "") -> PlottedRun:
    return PlottedRun(run.setup.options, run.setup.reference, run.records, label)


def write_report(folders: Sequence[Path], file: Path) -> list[RecordedRun]:
    """Write the page, and return its runs.

    Raises:
        ConfigError: a folder holds no run, or the file cannot be written.
    """
    runs = [read_run(folder) for folder in folders]
    page = report_page(runs)
    try:
        with replacing(file) as draft:
            draft.write_text(page, encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise ConfigError(
            f"report {file}: {why(error)}", "name a file that can be written"
        ) from None
    return runs


def report_page(runs: Sequence[RecordedRun]) -> str:
    """HTML with everything in it."""
    environment = Environment(loader=PackageLoader("ccr_host.record", "."), autoescape=True)
    environment.filters |= {
        "mm": _mm,
        "ratio": ratio_to_twin_floor,
        "dash": _dash,
        "configuration": _configuration,
        "why_measured_differs": why_measured_differs,
    }
    figures = [
        (svg_element(run_figure([_plotted(run)])), health_svg(run)) if run.records else ("", "")
        for run in runs
    ]
    titles = [run.title for run in runs]
    names = [
        title if titles.count(title) == 1 else f"{title}, {run.folder.name}"
        for run, title in zip(runs, titles, strict=True)
    ]
    return environment.get_template("page.html.j2").render(
        title=titles[0] if len({*titles}) == 1 else f"{len(runs)} runs",
        runs=runs,
        names=names,
        figures=figures,
        overlays=list(overlay_svgs(runs, names)),
    )


def _mm(value: float | Undefined | None) -> str:
    return f"{value:.2f}" if isinstance(value, float) else _DASH


def _dash(value: int | Undefined | None) -> str:
    return str(value) if isinstance(value, int) else _DASH


def _configuration(run: RecordedRun) -> str:
    options = {**vars(run.setup.options), "overrides": list(run.setup.options.overrides)}
    content = {
        "versions": run.versions,
        "options": options,
        "description": run.setup.description.model_dump(),
    }
    return json.dumps(content, indent=2)
