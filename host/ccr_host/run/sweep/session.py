"""A sweep from its jobs to its folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from ccr_host.run.folder import write_json
from ccr_host.run.sweep.figure import write_sweep_figure
from ccr_host.run.sweep.job import Row
from ccr_host.run.sweep.plan import TwinJob
from ccr_host.run.sweep.statistics import groups_of
from ccr_host.run.sweep.store import SweepFolder
from ccr_host.run.sweep.workers import existing_cluster, local_workers, run_jobs

OnCount = Callable[[int], None]


def run_missing(
    store: SweepFolder,
    jobs: Sequence[TwinJob],
    workers: int | None,
    scheduler: str | None,
    on_count: OnCount,
) -> None:
    """Run what has no row yet, and keep each twin's rows as they come.

    Args:
        store: of the sweep.
        jobs: all of the sweep.
        workers: local processes; None for as many as there are cores.
        scheduler: address of an existing cluster, used instead.
        on_count: told of each row, first of those that are there already.

    Raises:
        ConfigError: no scheduler at that address.
        CcrError: the workers cannot do such jobs.
    """
    left = store.missing(jobs)
    on_count(sum(len(job.drives) for job in jobs) - sum(len(job.drives) for job in left))
    if not left:
        return
    count = min(workers or os.cpu_count() or 1, len(left))
    with existing_cluster(scheduler) if scheduler else local_workers(count) as client:
        for rows in run_jobs(client, left):
            store.keep(rows)
            on_count(len(rows))


def sum_up(store: SweepFolder, folder: Path) -> list[Row]:
    """Gather the rows and write figure and summary of what is there; returns the rows."""
    rows = store.gather()
    write_sweep_figure(folder / "figure.png", rows)
    write_json(folder / "summary.json", {"groups": groups_of(rows)})
    return rows
