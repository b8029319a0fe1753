"""Turns the result of a run into its folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ccr_host.errors import full_text
from ccr_host.run.figure import PlottedRun, write_run_figure
from ccr_host.run.folder import FIGURES, METRICS_FILE, TIMING_FILE, ResultFolder
from ccr_host.run.log.files import LOG_PREFIX, log_files
from ccr_host.run.summary import TIMING_KEYS, RunResult, summarise
from ccr_host.run.twin_floor import twin_floor_mm
from ccr_host.run.versions import versions
from ccr_host.stop_signals import signals_deferred

_MANY_LOGS = 4


@dataclass(frozen=True)
class KeptRun:
    """What is in the folder of a run, and what is to be told about it."""

    summary: dict[str, Any]
    failure: Exception | KeyboardInterrupt | None
    """What ended the run early, or has interrupted what came after it."""
    no_open_loop: str
    """Why the comparison is missing; empty if it is not."""


def keep_result(
    folder: ResultFolder, result: RunResult, open_loop_result: Callable[[], RunResult] | None
) -> KeptRun:
    """Write run.json, timing.json and the figure as PNG, PDF and SVG; of a start that failed none.

    ``run.json`` repeats with the seed in virtual time; what measures the machine is apart. An
    interruption ends the wait for the open loop, and nothing else.

    Args:
        folder: of the run, with its log.
        result: of the run.
        open_loop_result: waits for the same run under the open loop; None without a comparison.
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
    summary = summarise(result, open_loop, twin_floor_mm(result))
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
