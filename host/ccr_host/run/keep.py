"""Turns the result of a run into its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ccr_host.run.figure import PlottedRun, write_run_figure
from ccr_host.run.folder import METRICS_FILE, write_json
from ccr_host.run.summary import TIMING_KEYS, RunResult, summarise
from ccr_host.run.twin_floor import twin_floor_mm
from ccr_host.run.versions import versions


def keep_result(folder: Path, result: RunResult, open_loop: RunResult | None) -> dict[str, Any]:
    """Write run.json, timing.json and the figure as PNG, PDF and SVG.

    ``run.json`` repeats with the seed in virtual time; what measures the machine is apart.

    Returns:
        The JSON summary.
    """
    summary = summarise(result, open_loop, twin_floor_mm(result))
    write_json(
        folder / METRICS_FILE,
        {
            "versions": versions(),
            "options": vars(result.options),
            "description": result.options.description().model_dump(),
            "metrics": {key: summary[key] for key in summary if key not in TIMING_KEYS},
        },
    )
    write_json(folder / "timing.json", {key: summary[key] for key in TIMING_KEYS})
    if result.records:
        shown = [result] if open_loop is None else [result, open_loop]
        runs = [PlottedRun(run.options, run.reference, run.records) for run in shown]
        write_run_figure(folder / "figure.png", runs)
    return summary
