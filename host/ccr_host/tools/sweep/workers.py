"""Jobs on dask.distributed: processes of this machine, or an existing cluster."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed
from distributed.core import rpc

from ccr_host.core.errors import CcrError, ConfigError, why
from ccr_host.core.standard_streams import keep_output_for_summary
from ccr_host.record.folder import FIGURES, ResultFolder
from ccr_host.tools.sweep.job import Row, run_job
from ccr_host.tools.sweep.plan import TwinJob
from ccr_host.tools.sweep.statistics import groups_of, write_sweep_figure
from ccr_host.tools.sweep.store import GATHERED, SweepFolder

OnCount = Callable[[int], None]


def run_missing(
    store: SweepFolder,
    jobs: Sequence[TwinJob],
    workers: int | None,
    scheduler: str | None,
    on_count: OnCount,
) -> None:
    """Run all runs without a row, and store each twin's rows as they arrive.

    Without ``workers`` there is one process per core; ``scheduler`` is the address of a cluster,
    used instead. ``on_count`` is called with numbers of finished rows, first with that of the
    existing ones.

    Raises:
        ConfigError: no scheduler at that address.
        CcrError: the workers cannot run the jobs, a row cannot be stored, or twins are missing
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
                    "free disk space; the same command continues the sweep",
                ) from None
            on_count(len(rows))
    if lost:
        twins = ", ".join(map(str, sorted(lost)))
        raise CcrError(
            f"twins are missing, as their workers were killed repeatedly: {twins}",
            "check for lack of memory, use fewer --workers; the same command runs them again",
        )


def sum_up(store: SweepFolder, folder: ResultFolder) -> list[Row]:
    """Gather the rows, write their figure and summary, and return them."""
    rows = store.rows()
    folder.keep(lambda _: store.gather(), GATHERED)
    folder.keep_json("summary.json", {"groups": groups_of(rows)})
    folder.keep(lambda file: write_sweep_figure(file, rows), *FIGURES)
    return rows


_CONNECT_S = 10
_IDENTIFY_S = 5
"""A scheduler identifies itself within milliseconds; a client would wait minutes for one."""


@contextmanager
def local_workers(count: int) -> Iterator[Client]:
    """Worker processes of one thread each; one that dies is replaced and its job repeated.

    A client that connects to a scheduler can run any code on its workers. So connections require
    certificates known only to these processes, and dask's web pages are disabled.
    """
    _silence()
    pages: dict[str, list[str]] = {
        f"distributed.{server}.http.routes": [] for server in ("scheduler", "worker")
    }
    with (
        dask.config.set(pages),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            security=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@contextmanager
def existing_cluster(address: str) -> Iterator[Client]:
    """Workers of an existing scheduler, each with this version of ccr-host installed.

    Raises:
        ConfigError: no scheduler answers there, or the address is invalid.
    """
    _silence()
    try:
        asyncio.run(asyncio.wait_for(_require_scheduler(address), _IDENTIFY_S))
        client = Client(address, timeout=_CONNECT_S)
    except Exception as error:  # a reply of any other service is decoded as if it were dask's
        telling = isinstance(error, OSError | TypeError) and str(error)
        raise ConfigError(
            f"--scheduler {address}: no dask scheduler answers there"
            + (f" ({_first_line(error)})" if telling else ""),
            "start one with: dask scheduler; give its address, e.g. tcp://127.0.0.1:8786",
        ) from None
    with client:
        yield client


def run_jobs(client: Client, jobs: Sequence[TwinJob]) -> Iterator[tuple[TwinJob, list[Row] | None]]:
    """Yield each job with its rows, in the order in which the jobs end.

    A job whose worker is killed is repeated on others; after several killed workers its rows are
    None.

    Raises:
        CcrError: the workers cannot run the jobs.
    """
    job_of: dict[Future, TwinJob] = {
        client.submit(_run_job, job, key=f"twin-{job.index}", pure=False, priority=-job.index): job
        for job in jobs
    }
    try:
        for future in as_completed(list(job_of)):
            job = job_of.pop(future)
            yield job, _rows(future, job)
    finally:
        client.cancel(list(job_of))


def _run_job(job: TwinJob) -> list[Row]:
    keep_output_for_summary()
    return run_job(job)


def _rows(future: Future, job: TwinJob) -> list[Row] | None:
    error = future.exception()
    if error is None:
        rows: list[Row] = future.result()
        return rows
    if isinstance(error, KilledWorker):
        return None
    if isinstance(error, CcrError):
        raise error
    raise CcrError(
        f"twin {job.index}: {type(error).__name__}: {_first_line(error)}",
        f"see ccr-host sweep --only {job.index}; workers need this version of ccr-host",
    )


async def _require_scheduler(address: str) -> None:
    async with rpc(address, timeout=_IDENTIFY_S) as peer:
        identity = await peer.identity()
    if identity["type"] != "Scheduler":
        raise TypeError(f"it is a {identity['type']}")


def _silence() -> None:
    """Silence dask's log: the sweep itself reports killed workers."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
