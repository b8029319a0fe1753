"""The command ``ccr-host sweep``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.commands.options import (
    JsonOption,
    OutOption,
    Without,
    complete_controllers,
    complete_paths,
    console_beside,
    print_json,
    tell_kept,
)
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

    from rich.console import Console

    from ccr_host.commands.terminal import OnCount
    from ccr_host.tools.sweep.job import Row
    from ccr_host.tools.sweep.plan import TwinJob

_DEFAULT_CONTROLLERS = ["adaptive", "mpc"]
_DEFAULT_RATES_HZ = [1.0, 20.0]
_DEFAULT_RUNS = 20


def sweep(
    rig: Annotated[RigOptions, Without("device", "tracker", "realtime")],
    runs: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            max=1_000_000,
            help=f"Number of twins; {_DEFAULT_RUNS}, or all of --twins.",
        ),
    ] = None,
    controller: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="May be repeated. Default: adaptive and mpc.",
            autocompletion=complete_controllers,
        ),
    ] = None,
    path: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH",
            help="May be repeated; twins alternate. Default: all three.",
            autocompletion=complete_paths,
        ),
    ] = None,
    rate: Annotated[
        list[float] | None,
        typer.Option(metavar="HZ", help="May be repeated. Default: 1 and 20."),
    ] = None,
    only: Annotated[
        list[int] | None,
        typer.Option(
            metavar="INDEX",
            min=0,
            max=2**31,
            help="Only this twin, in this process; saves nothing.",
        ),
    ] = None,
    twins: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Your own twins: one JSON object per line."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=1024, help="Processes; by default one per core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Use the workers of this dask scheduler."),
    ] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run controllers on many random twins. An unfinished sweep in --out is completed.

    Example: ccr-host sweep --runs 100 --controller adaptive --out sweep1
    """
    from ccr_host.core.errors import CcrError, ConfigError
    from ccr_host.core.plugins import import_optional
    from ccr_host.core.stop_signals import signals_deferred
    from ccr_host.record.folder import ResultFolder
    from ccr_host.robot.paths import PAPER_PATHS
    from ccr_host.tools.sweep.plan import SweepPlan, read_twins

    given = None if twins is None else read_twins(twins)
    known = _DEFAULT_RUNS if given is None else len(given)
    count = known if runs is None else runs
    if given is not None and max([count - 1, *(only or ())]) >= len(given):
        raise ConfigError(f"--twins {twins}: has {len(given)} twins", "ask for no more")
    plan = SweepPlan(
        rig.seed, tuple(path or PAPER_PATHS), rig.robot, rig.overrides, given, rig.plant
    )
    names, rates = controller or _DEFAULT_CONTROLLERS, rate or _DEFAULT_RATES_HZ
    drives = [(rate_hz, name) for rate_hz in rates for name in names]
    jobs = plan.jobs(only or range(count), drives)
    screen = console_beside(as_json=as_json)
    if only:
        rows = _run_here(jobs)
        for row in rows:
            screen.print(row["command"], soft_wrap=True)
        _show(rows, screen, as_json=as_json)
        return
    for package in ("distributed", "pyarrow"):
        import_optional(package, "sweep", "ccr-host sweep")
    from ccr_host.tools.sweep.store import SweepFolder
    from ccr_host.tools.sweep.workers import run_missing, sum_up

    with ResultFolder(out, "sweep") as folder:
        store = SweepFolder(folder.path, plan)
        failure: CcrError | KeyboardInterrupt | None = None
        try:
            with _progress(jobs) as on_count:
                run_missing(store, jobs, workers, scheduler, on_count)
        except (CcrError, KeyboardInterrupt) as error:
            failure = error
        if store.rows():
            try:
                with signals_deferred():
                    rows = sum_up(store, folder)
            except KeyboardInterrupt as error:
                failure = failure or error
            _show(rows, screen, as_json=as_json)
            tell_kept(screen, folder)
            screen.print(
                "--only INDEX repeats a twin and prints its ccr-host track command", soft_wrap=True
            )
        if failure is not None:
            raise failure


def _run_here(jobs: Sequence[TwinJob]) -> list[Row]:
    from ccr_host.tools.sweep.job import run_job

    rows: list[Row] = []
    with _progress(jobs) as on_count:
        for job in jobs:
            rows += run_job(job)
            on_count(len(job.drives))
    return rows


def _progress(jobs: Sequence[TwinJob]) -> AbstractContextManager[OnCount]:
    from ccr_host.commands import terminal

    total = sum(len(job.drives) for job in jobs)
    return terminal.count_progress(total)


def _show(rows: Sequence[Row], screen: Console, *, as_json: bool) -> None:
    from ccr_host.commands import terminal
    from ccr_host.tools.sweep.statistics import groups_of

    groups = groups_of(rows)
    screen.print(terminal.sweep_table(groups))
    for line in terminal.worst_lines(groups):
        screen.print(line, soft_wrap=True)
    if as_json:
        print_json({"runs": len(rows), "groups": groups})
