"""Several runs at once, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.pool import Pool

from ccr_host.run.execute import execute_quietly
from ccr_host.run.options import RunOptions
from ccr_host.run.rig import is_simulated
from ccr_host.run.summary import RunResult
from ccr_host.run.twin_floor import keep_static_map


@contextmanager
def in_background(options: RunOptions) -> Iterator[Callable[[], RunResult]]:
    """Execute a run in another process; yields a function that waits for its result.

    Before it returns, the static map of the twin is in the user's cache too. Leaving the context
    without asking for the result ends the process.
    """
    with _workers(1) as pool:
        yield pool.apply_async(_execute_and_keep_map, (options,)).get


def execute_all(runs: Sequence[RunOptions]) -> Iterator[tuple[int, RunResult]]:
    """Execute runs, on all cores where all is simulated; yields index and result as each ends."""
    if not all(is_simulated(run) for run in runs):
        yield from map(_execute_numbered, enumerate(runs))
        return
    with _workers(min(len(runs), os.cpu_count() or 1)) as pool:
        yield from pool.imap_unordered(_execute_numbered, enumerate(runs))


def _execute_and_keep_map(options: RunOptions) -> RunResult:
    keep_static_map(options)
    return execute_quietly(options)


def _execute_numbered(numbered: tuple[int, RunOptions]) -> tuple[int, RunResult]:
    index, options = numbered
    return index, execute_quietly(options)


def _workers(count: int) -> Pool:
    # Ctrl-C reaches the whole process group; the parent decides what becomes of the workers.
    return multiprocessing.get_context("spawn").Pool(
        count, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_IGN)
    )
