"""A sweep from its jobs to its folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

from ccr_host.errors import CcrError, why
from ccr_host.run.folder import FIGURES, ResultFolder
from ccr_host.run.sweep.figure import write_sweep_figure
from ccr_host.run.sweep.job import Row
from ccr_host.run.sweep.plan import TwinJob
from ccr_host.run.sweep.statistics import groups_of
from ccr_host.run.sweep.store import GATHERED, SweepFolder
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
        CcrError: the workers cannot do such jobs, a row cannot be stored, or twins are missing
            because their workers were killed; all other rows are stored.
    """
    left = store.missing(jobs)
    on_count(sum(len(job.drives) for job in jobs) - sum(len(job.drives) for job in left))
    if not left:
        return
    count = min(workers or os.cpu_count() or 1, len(left))
    with existing_cluster(scheduler) if scheduler else local_workers(count) as client:
        lost: list[int] = []
        for job, rows in run_jobs(client, left):
            if rows is None:
                lost.append(job.index)
                continue
            try:
                store.keep(rows)
            except OSError as error:
                raise CcrError(
                    f"the sweep ends early: twin {job.index} cannot be stored: {why(error)}",
                    "the same command with room for its results goes on",
                ) from None
            on_count(len(rows))
    if lost:
        twins = ", ".join(map(str, sorted(lost)))
        raise CcrError(
            f"twins are missing, their workers were killed again and again: {twins}",
            "look for a lack of memory, give fewer --workers; the same command runs them again",
        )


def sum_up(store: SweepFolder, folder: ResultFolder) -> list[Row]:
    """Gather the rows and write figure and summary of what is there; returns the rows."""
    rows = store.rows()
    folder.keep(lambda _: store.gather(), GATHERED)
    folder.keep_json("summary.json", {"groups": groups_of(rows)})
    folder.keep(lambda file: write_sweep_figure(file, rows), *FIGURES)
    return rows
