"""Opens the log of a run in its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ccr_host.errors import ConfigError
from ccr_host.run.log.files import LOG_PREFIX, TIMING_PREFIX, LogFiles, log_files
from ccr_host.run.log.run_log import RunLog
from ccr_host.run.log.sinks import BackgroundSink, DirectSink
from ccr_host.run.log.topics import LOG_TOPICS, TIMING_TOPICS


@contextmanager
def open_run_log(folder: Path, *, realtime: bool) -> Iterator[RunLog]:
    """The log in its folder, closed at the end; one that is there already is removed.

    Args:
        folder: of the run.
        realtime: write from a thread of its own, and what measures the machine into the same files.

    Raises:
        ConfigError: no file can be made there.
    """
    try:
        for old in (*log_files(folder, LOG_PREFIX), *log_files(folder, TIMING_PREFIX)):
            old.unlink()
        run_log = _realtime_log(folder) if realtime else _repeatable_log(folder)
    except OSError as error:
        raise ConfigError(
            f"log in {folder}: {error.strerror}", "name a folder that can be written"
        ) from None
    try:
        yield run_log
    finally:
        run_log.close()


def _realtime_log(folder: Path) -> RunLog:
    files = LogFiles(folder, LOG_PREFIX, LOG_TOPICS)
    return RunLog(BackgroundSink(files, LOG_TOPICS), timing=None)


def _repeatable_log(folder: Path) -> RunLog:
    log, timing = (
        DirectSink(LogFiles(folder, prefix, of), of)
        for prefix, of in ((LOG_PREFIX, LOG_TOPICS), (TIMING_PREFIX, TIMING_TOPICS))
    )
    return RunLog(log, timing)
