"""The command ``ccr-host compare``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from ccr_host.commands.options import (
    JsonOption,
    OutOption,
    RateOption,
    SurfaceOption,
    UncheckedOption,
    complete_controllers,
    complete_paths,
    console_beside,
    print_json,
    print_notes,
    tell_kept,
)
from ccr_host.core.errors import CcrError
from ccr_host.run.options import RigOptions, RunOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccr_host.record.folder import ResultFolder
    from ccr_host.run.summary import RunResult


def compare(
    rig: RigOptions,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Only this controller; may be repeated. Default: all but the baselines.",
            autocompletion=complete_controllers,
        ),
    ] = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines", "--peers", help="Also the field's usual controllers; see the docs."
        ),
    ] = False,
    path: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH",
            help="Only this path; may be repeated. Default: all three.",
            autocompletion=complete_paths,
        ),
    ] = None,
    rate: RateOption = 1.0,
    surface: SurfaceOption = "model",
    unchecked: UncheckedOption = False,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare the open loop and all controllers on the paper's paths.

    Example: ccr-host compare --robot hard
    """
    from ccr_host.commands import terminal
    from ccr_host.control.registry import baseline_names, controller_names
    from ccr_host.core.stop_signals import signals_deferred
    from ccr_host.record.comparisons import PAPER_RESULTS
    from ccr_host.record.folder import ResultFolder
    from ccr_host.run.campaign import execute_all
    from ccr_host.run.execute import reference_of
    from ccr_host.run.summary import RunResult

    chosen = controller or controller_names()
    names = list(dict.fromkeys([*chosen, *baseline_names()] if baselines else chosen))
    runs = [
        RunOptions(
            **vars(rig),
            path=one_path,
            controller=name,
            rate_hz=rate,
            checks="none" if unchecked else "motion",
            surface=surface,
        )
        for one_path in path or PAPER_RESULTS
        for name in names
    ]
    print_notes(runs)
    for run in runs:
        reference_of(run)  # rejects bad options before the first run starts
    screen = console_beside(as_json=as_json)
    results: dict[int, RunResult] = {}
    failures: list[Exception | KeyboardInterrupt] = []
    with ResultFolder(out, "compare") as folder:
        try:
            with terminal.count_progress(len(runs)) as count:
                for index, outcome in execute_all(runs):
                    count()
                    if not isinstance(outcome, RunResult):
                        failures.append(_of_run(runs[index], outcome))
                        continue
                    results[index] = outcome
                    if outcome.failure is not None:
                        failures.append(outcome.failure)
        except KeyboardInterrupt as interruption:
            failures.insert(0, interruption)
        done = [results[index] for index in sorted(results)]
        content: dict[str, Any] = {}
        try:
            with signals_deferred():
                if any(result.records for result in done):
                    content = _keep(folder, done)
        except KeyboardInterrupt as interruption:
            failures.insert(0, interruption)
        if content:
            screen.print(terminal.comparison_table(content["runs"], [run.options for run in done]))
            for line in terminal.remarks(done):
                screen.print(line)
            tell_kept(screen, folder)
            if as_json:
                print_json(content)
        if failures:
            raise failures[0]


def _keep(folder: ResultFolder, results: Sequence[RunResult]) -> dict[str, Any]:
    """Write compare.json and the figure; return the content of the former."""
    from ccr_host.record.comparisons import PAPER_RESULTS
    from ccr_host.record.figure import PlottedRun, write_comparison_figure
    from ccr_host.record.folder import FIGURES
    from ccr_host.run.summary import summarise
    from ccr_host.run.twin_floor import floor_of_run_mm

    content = {
        "runs": [summarise(result, twin_floor_mm=floor_of_run_mm(result)) for result in results],
        "paper": {path: vars(figures) for path, figures in PAPER_RESULTS.items()},
    }
    folder.keep_json("compare.json", content)
    groups: dict[str, list[PlottedRun]] = {}
    for run in results:
        if run.records:
            plotted = PlottedRun(run.options, run.reference, run.records)
            groups.setdefault(run.options.path, []).append(plotted)
    if groups:
        folder.keep(lambda file: write_comparison_figure(file, [*groups.values()]), *FIGURES)
    return content


def _of_run(run: RunOptions, error: Exception) -> Exception:
    """Add the path and controller to the cause of our own errors."""
    if isinstance(error, CcrError):
        error.cause = f"{run.path} with {run.controller}: {error.cause}"
    return error
