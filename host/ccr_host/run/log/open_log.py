"""Opens the log of a run in its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ccr_host.run.folder import remove_earlier_run
from ccr_host.run.log.files import LOG_PREFIX, TIMING_PREFIX, LogFiles
from ccr_host.run.log.run_log import RunLog
from ccr_host.run.log.sinks import BackgroundSink, DirectSink, Sink
from ccr_host.run.log.topics import LOG_TOPICS, TIMING_TOPICS
from ccr_host.stop_signals import signals_deferred


@contextmanager
def open_run_log(folder: Path, *, realtime: bool) -> Iterator[RunLog]:
    """The log in its folder, closed at the end, however often it is interrupted then.

    Files of an earlier run are removed once this one starts.

    Args:
        folder: of the run.
        realtime: write from a thread of its own, and what measures the machine into the same files.
    """

    def open_sinks() -> tuple[Sink, Sink | None]:
        with suppress(OSError):  # if it stays so, the log has the same trouble
            remove_earlier_run(folder)
        return _realtime_sinks(folder) if realtime else _repeatable_sinks(folder)

    run_log = RunLog(open_sinks)
    try:
        yield run_log
    finally:
        with signals_deferred():
            run_log.close()


def _realtime_sinks(folder: Path) -> tuple[Sink, Sink | None]:
    return BackgroundSink(LogFiles(folder, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS), None


def _repeatable_sinks(folder: Path) -> tuple[Sink, Sink | None]:
    log, timing = (
        DirectSink(LogFiles(folder, prefix, of), of)
        for prefix, of in ((LOG_PREFIX, LOG_TOPICS), (TIMING_PREFIX, TIMING_TOPICS))
    )
    return log, timing
