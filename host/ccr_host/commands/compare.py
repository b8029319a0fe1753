"""The command ``ccr-host compare``."""

from __future__ import annotations

from typing import Annotated

import typer

from ccr_host import terminal
from ccr_host.commands import completion
from ccr_host.commands.options import (
    DeviceOption,
    JsonOption,
    OutOption,
    RateOption,
    RealtimeOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
    warn_of_mismatch,
)
from ccr_host.commands.output import console, print_json
from ccr_host.run.options import RunOptions


def compare(
    controller: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Only this controller; may be repeated. Default: all but peers.",
            autocompletion=completion.controllers,
        ),
    ] = None,
    peers: Annotated[
        bool, typer.Option("--peers", help="The field's usual controllers too; see the docs.")
    ] = False,
    path: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH",
            help="Only this path; may be repeated. Default: all three.",
            autocompletion=completion.paths,
        ),
    ] = None,
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    rate: RateOption = 1.0,
    seed: SeedOption = 1,
    overrides: SetOption = None,
    realtime: RealtimeOption = False,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Open loop against every controller on the paper's paths.

    Example: ccr-host compare --robot hard
    """
    from ccr_host.control.registry import controller_names, peer_names
    from ccr_host.run.campaign import execute_all
    from ccr_host.run.execute import reference_of
    from ccr_host.run.figure import PlottedRun, write_comparison_figure
    from ccr_host.run.folder import make_run_folder, write_json
    from ccr_host.run.paper_results import PAPER_RESULTS
    from ccr_host.run.summary import summarise
    from ccr_host.run.twin_floor import twin_floor_mm

    chosen = controller or controller_names()
    names = list(dict.fromkeys([*chosen, *peer_names()] if peers else chosen))
    runs = [
        RunOptions(
            path=one_path,
            controller=name,
            robot=robot,
            overrides=tuple(overrides or ()),
            device=device,
            tracker=tracker,
            rate_hz=rate,
            seed=seed,
            realtime=realtime,
        )
        for one_path in path or PAPER_RESULTS
        for name in names
    ]
    warn_of_mismatch(runs[0])
    references = {run.path: reference_of(run) for run in runs}
    folder = make_run_folder(out, "compare")
    screen = console(on_stderr=as_json)
    results = {}
    with terminal.count_progress(console(on_stderr=True), "runs", len(runs)) as count:
        for index, result in execute_all(runs):
            results[index] = result
            count()
    summaries = [
        summarise(result, twin_floor_mm=twin_floor_mm(result))
        for result in (results[index] for index in range(len(runs)))
    ]
    groups = [
        [
            PlottedRun(run, reference, results[index].records)
            for index, run in enumerate(runs)
            if run.path == one_path
        ]
        for one_path, reference in references.items()
    ]
    write_comparison_figure(folder / "figure.png", groups)
    content = {"runs": summaries, "paper": {k: vars(v) for k, v in PAPER_RESULTS.items()}}
    write_json(folder / "compare.json", content)
    screen.print(terminal.comparison_table(summaries, runs))
    for line in terminal.true_error_lines([result.records for result in results.values()]):
        screen.print(line)
    screen.print(f"kept in {folder}/: figure.png, compare.json")
    if as_json:
        print_json(content)
    for result in results.values():
        if result.failure is not None:
            raise result.failure
