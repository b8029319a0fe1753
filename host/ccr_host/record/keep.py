"""A run that leaves a folder: its log while it runs, its summary and figure afterwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ccr_host.core.errors import full_text
from ccr_host.core.stop_signals import signals_deferred
from ccr_host.record.figure import PlottedRun, write_run_figure
from ccr_host.record.folder import FIGURES, METRICS_FILE, TIMING_FILE, ResultFolder, versions
from ccr_host.record.log.files import LOG_PREFIX, log_files
from ccr_host.record.log.run_log import open_run_log
from ccr_host.run.execute import execute
from ccr_host.run.loop import Progress
from ccr_host.run.observer import Observers, RunObserver
from ccr_host.run.open_rig import is_simulated
from ccr_host.run.options import RunOptions
from ccr_host.run.rig import Operator
from ccr_host.run.summary import TIMING_KEYS, RunResult, summarise
from ccr_host.run.twin_floor import floor_of_run_mm

_MANY_LOGS = 4


def execute_logged(
    options: RunOptions,
    folder: Path,
    on_step: Progress,
    onlookers: Sequence[RunObserver] = (),
    operator: Operator | None = None,
) -> RunResult:
    """Run with the log in its folder; the onlookers see what the log sees."""
    result: RunResult | None = None
    late: KeyboardInterrupt | None = None
    try:
        with open_run_log(folder, realtime=not is_simulated(options)) as log:
            result = execute(options, Observers((log, *onlookers)), on_step, operator)
    except KeyboardInterrupt as error:
        if result is None:
            raise
        late = error
    return replace(
        result,
        failure=result.failure or late,
        started=log.started,
        log_trouble=log.trouble,
    )


@dataclass(frozen=True)
class KeptRun:
    """The outcome of keeping a run in its folder."""

    summary: dict[str, Any]
    failure: Exception | KeyboardInterrupt | None
    """The error that ended the run early, or the interruption of what followed it."""
    no_open_loop: str
    """Why the comparison is missing; empty if it is not."""


def keep_result(
    folder: ResultFolder, result: RunResult, open_loop_result: Callable[[], RunResult] | None
) -> KeptRun:
    """Write run.json, timing.json and the figure as PNG, PDF and SVG; of a start that failed none.

    ``run.json`` repeats with the seed in virtual time; what measures the machine is apart. An
    interruption ends the wait for the open loop, and nothing else. ``open_loop_result`` waits for
    the same run under the open loop; None without a comparison.
    """
    failure, open_loop, no_open_loop = result.failure, None, ""
    summary: dict[str, Any] = {}
    try:
        try:
            if open_loop_result is not None and failure is None:
                open_loop = open_loop_result()
        except Exception as error:
            no_open_loop = f"no comparison with the open loop: {full_text(error)}"
        finally:
            with signals_deferred():
                summary = _write(folder, result, open_loop)
    except KeyboardInterrupt as interruption:
        failure = failure or interruption
    return KeptRun(summary, failure, no_open_loop)


def _write(folder: ResultFolder, result: RunResult, open_loop: RunResult | None) -> dict[str, Any]:
    summary = summarise(result, open_loop, floor_of_run_mm(result))
    if not result.started:
        return summary
    content = {
        "versions": versions(),
        "options": vars(result.options),
        "description": result.options.description().model_dump(),
        "metrics": {key: summary[key] for key in summary if key not in TIMING_KEYS},
    }
    folder.keep_json(METRICS_FILE, content)
    folder.keep_json(TIMING_FILE, {key: summary[key] for key in TIMING_KEYS})
    if result.records:
        shown = [result] if open_loop is None else [result, open_loop]
        runs = [PlottedRun(run.options, run.reference, run.records) for run in shown]
        folder.keep(lambda file: write_run_figure(file, runs), *FIGURES)
    logs = [file.name for file in log_files(folder.path, LOG_PREFIX)]
    folder.kept += logs if len(logs) < _MANY_LOGS else [logs[0], "...", logs[-1]]
    return summary
