"""Entry point: whatever goes wrong is one line and an exit status.

All but the least is imported under its protection: that takes long enough to be interrupted.
"""

from __future__ import annotations

import sys
import tempfile
import traceback
from importlib import import_module
from typing import NoReturn

from ccr_host.core.errors import CcrError, CodeError
from ccr_host.core.standard_streams import keep_streams_writable, lost_output, warn
from ccr_host.core.stop_signals import stop_signals_interrupt

EXIT_DEFECT = 3
"""Nothing that the user could correct, as with a device that fails."""
EXIT_INTERRUPTED = 130


def main() -> NoReturn:
    """Do what the command line says, and end the process."""
    status = 0
    error: BaseException | None = None
    try:
        with stop_signals_interrupt():
            keep_streams_writable()
            status = import_module("ccr_host.commands.app").run(sys.argv[1:])
        # Typer turns Ctrl-C into this status without a word.
        error = KeyboardInterrupt() if status == EXIT_INTERRUPTED else None
    except BaseException as caught:
        error = KeyboardInterrupt() if _is_interruption(caught) else caught
    if error is not None:
        status, message = _verdict(error)
        if message:
            warn(message)
            sys.stderr.write(error.traceback if isinstance(error, CodeError) else "")
    sys.stdout.flush()
    if why := lost_output():
        warn(f"standard output is incomplete: {why}")
    sys.exit(status)


def _is_interruption(error: BaseException | None) -> bool:
    """Whether it is one, or what a library of C has made of one that came while it was imported."""
    if error is None or isinstance(error, CcrError | KeyboardInterrupt):
        return isinstance(error, KeyboardInterrupt)
    return _is_interruption(error.__cause__)


def _verdict(error: BaseException) -> tuple[int, str]:
    """Exit status and message."""
    match error:
        case CcrError():
            cure = f"; {error.cure}" if error.cure else ""
            return error.exit_status, f"error: {error.cause}{cure}"
        case KeyboardInterrupt():
            return EXIT_INTERRUPTED, "interrupted"
        case SystemExit(code=None | 0):
            return 0, ""
    return EXIT_DEFECT, (
        f"error: a defect of ccr-host: {type(error).__name__}: {error}; "
        f"please report it with {_kept_traceback(error)}"
    )


def _kept_traceback(error: BaseException) -> str:
    """Where the traceback was written."""
    text = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="ccr-host-", suffix=".txt", encoding="utf-8", errors="replace", delete=False
        ) as file:
            file.write(text)
    except OSError as failure:
        return f"what led to it (its traceback could not be kept: {failure.strerror})"
    return file.name
