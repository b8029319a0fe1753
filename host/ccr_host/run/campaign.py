"""Several runs at once, in separate processes.

A process may be killed at any time, for example when memory runs out: its run is then repeated, or
reported as lost.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection, wait
from typing import Self

from ccr_host.core.errors import CcrError, full_text
from ccr_host.core.standard_streams import keep_output_for_summary
from ccr_host.core.stop_signals import cause_of_death
from ccr_host.run.execute import execute_quietly
from ccr_host.run.open_rig import is_simulated
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult
from ccr_host.run.twin_floor import floor_of_run_mm

ATTEMPTS = 3
"""Number of attempts at a run whose process is killed."""

Outcome = RunResult | Exception
Work = Callable[[RunOptions], Outcome]


class ProcessLostError(CcrError):
    """The process of a run was killed."""


@contextmanager
def in_background(options: RunOptions) -> Iterator[Callable[[], RunResult]]:
    """Execute a run in another process; yields a function that waits for its result.

    By then the floor of its path is in the user's cache, too. Leaving the context without asking
    for the result ends the process. The function raises ProcessLostError, or the error of the run.
    """
    with _Worker() as worker:
        worker.begin(_execute_and_keep_floor, options)

        def result() -> RunResult:
            outcome = worker.outcome()
            if isinstance(outcome, RunResult):
                return outcome
            raise outcome

        yield result


def execute_all(runs: Sequence[RunOptions]) -> Iterator[tuple[int, Outcome]]:
    """Execute runs, on all cores if everything is simulated.

    On a real robot the first failure ends them all, since the robot must be inspected.

    Yields:
        Index, and result or error, of each run when it ends.
    """
    if all(is_simulated(run) for run in runs):
        yield from _in_parallel(runs)
        return
    for index, run in enumerate(runs):
        outcome = _execute(run)
        yield index, outcome
        if not isinstance(outcome, RunResult) or outcome.failure is not None:
            return


def _in_parallel(runs: Sequence[RunOptions]) -> Iterator[tuple[int, Outcome]]:
    waiting = deque((index, 1) for index in range(len(runs)))
    running: dict[Connection, tuple[_Worker, int, int]] = {}
    with ExitStack() as stack:
        idle = [stack.enter_context(_Worker()) for _ in range(min(len(runs), os.cpu_count() or 1))]
        while waiting or running:
            while waiting and idle:
                worker, (index, attempt) = idle.pop(), waiting.popleft()
                worker.begin(_execute, runs[index])
                running[worker.connection] = worker, index, attempt
            ready = wait([*running])
            for connection in [connection for connection in running if connection in ready]:
                worker, index, attempt = running.pop(connection)
                outcome = worker.outcome()
                if not isinstance(outcome, ProcessLostError):
                    idle.append(worker)
                else:
                    idle.append(stack.enter_context(_Worker()))
                    if attempt < ATTEMPTS:
                        waiting.append((index, attempt + 1))
                        continue
                yield index, outcome


class _Worker:
    """A process that executes runs one by one; ends with the context or with this process."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.join()
        self.connection.close()

    def begin(self, work: Work, options: RunOptions) -> None:
        """Start work; `connection` becomes readable when it is done, or the process dies."""
        try:
            self.connection.send((work, options))
        except OSError:
            return  # it is dead, which `outcome` reports

    def outcome(self) -> Outcome:
        """Wait for the result or the error of the work."""
        try:
            outcome: Outcome = self.connection.recv()
        except (EOFError, OSError):
            self._process.join()
            return ProcessLostError(
                f"its process was killed ({cause_of_death(self._process.exitcode)})",
                "look for a lack of memory",
            )
        return outcome


def _work(connection: Connection) -> None:
    # Ctrl-C reaches the whole process group; the parent decides what becomes of its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_output_for_summary()
    while True:
        try:
            work, options = connection.recv()
            outcome = work(options)
            try:
                connection.send(outcome)
            except (TypeError, AttributeError, ValueError) as error:
                connection.send(CcrError(f"its result cannot be passed on: {full_text(error)}"))
        except (EOFError, OSError):
            return  # the parent is gone


def _execute_and_keep_floor(options: RunOptions) -> Outcome:
    outcome = _execute(options)
    if isinstance(outcome, RunResult):
        floor_of_run_mm(outcome)
    return outcome


def _execute(options: RunOptions) -> Outcome:
    try:
        return execute_quietly(options)
    except Exception as error:
        return error
