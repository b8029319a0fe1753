"""The standard streams: their failure never stops a command or changes its exit status."""

from __future__ import annotations

import io
import os
import select
import sys
from typing import TYPE_CHECKING, TextIO

from ccr_host.core.errors import why
from ccr_host.core.user_file import printable

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_STANDARD_STREAMS = 3
_LONGEST_MESSAGE = 2000
_output: TextIO | None = None
"""Where `sys.stdout` was, of which a process has one; None while it is there."""


def keep_streams_writable() -> None:
    """Make standard output and standard error ignore all errors from now on.

    The terminal may be closed, the reader of a pipe may exit, a disk may be full, the locale may
    lack a character. A stream that was closed at the start is connected to the null device, so that
    no log or port is given its file descriptor.
    """
    _fill_missing_streams()
    if sys.stdin is None:
        sys.stdin = io.TextIOWrapper(io.BufferedReader(io.FileIO(0, closefd=False)))
    sys.stdout = _lasting(sys.stdout, 1)
    sys.stderr = _lasting(sys.stderr, 2)


def keep_output_for_summary() -> None:
    """Send what is printed from now on, by plug-ins too, to standard error, except `output`.

    Their C libraries, and processes started later, write to file descriptor 1 itself.
    """
    global _output
    if sys.stdout is sys.stderr:
        return
    summary = sys.stdout
    if isinstance(getattr(getattr(summary, "buffer", None), "raw", None), _LastingFile):
        summary.flush()
        summary = _lasting(summary, os.dup(1))
        os.dup2(2, 1)
    _output, sys.stdout = summary, sys.stderr


def output() -> TextIO:
    """Standard output, whether or not it is kept for the summary."""
    return _output if _output is not None and sys.stdout is sys.stderr else sys.stdout


def lost_output() -> str:
    """Why standard output was not written; empty if it was, or if the reader of a pipe exited."""
    error = _output_error()
    return "" if error is None or isinstance(error, BrokenPipeError) else why(error)


def is_output_lost() -> bool:
    """Whether further printing is pointless."""
    return _output_error() is not None


def warn(text: str) -> None:
    """Write one line to standard error."""
    sys.stderr.write(f"ccr-host: {printable(text, _LONGEST_MESSAGE)}\n")


def _output_error() -> OSError | None:
    raw = getattr(getattr(output(), "buffer", None), "raw", None)
    return raw.error if isinstance(raw, _LastingFile) else None


class _LastingFile(io.FileIO):
    """A file that accepts all data and drops what cannot be written."""

    error: OSError | None = None

    def write(self, data: ReadableBuffer) -> int:
        try:
            while (written := super().write(data)) is None:  # a non-blocking pipe that is full
                select.select([], [self], [])
        except OSError as error:
            self.error = error
            return memoryview(data).nbytes
        return written


def _lasting(stream: TextIO | None, descriptor: int) -> io.TextIOWrapper:
    buffer = io.BufferedWriter(_LastingFile(descriptor, "wb", closefd=False))
    return io.TextIOWrapper(
        buffer,
        encoding="utf-8" if stream is None else stream.encoding,
        errors="backslashreplace",
        line_buffering=stream is sys.stderr or buffer.isatty(),
    )


def _fill_missing_streams() -> None:
    while (descriptor := os.open(os.devnull, os.O_RDWR)) < _STANDARD_STREAMS:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
