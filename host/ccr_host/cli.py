"""Entry point: every failure becomes one line and an exit status.

Most modules are imported inside `main`, as importing takes long enough to be interrupted.
"""

from __future__ import annotations

import sys
import traceback
from importlib import import_module
from typing import NoReturn

from ccr_host.core.errors import CcrError, CodeError, why
from ccr_host.core.standard_streams import keep_streams_writable, lost_output, output, warn
from ccr_host.core.stop_signals import stop_signals_interrupt
from ccr_host.core.user_file import keep_elsewhere

EXIT_DEFECT = 3
"""Status for defects, the same as for a failing device: the user cannot correct either."""
EXIT_INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command line and exit."""
    status = 0
    error: BaseException | None = None
    try:
        with stop_signals_interrupt():
            keep_streams_writable()
            status = import_module("ccr_host.commands.app").run(sys.argv[1:])
        # Typer silently turns Ctrl-C into this status.
        error = KeyboardInterrupt() if status == EXIT_INTERRUPTED else None
    except BaseException as caught:
        error = KeyboardInterrupt() if _is_interruption(caught) else caught
    if error is not None:
        status, message = _verdict(error)
        if message:
            warn(message)
            sys.stderr.write(error.traceback if isinstance(error, CodeError) else "")
    output().flush()
    if why := lost_output():
        warn(f"standard output is incomplete: {why}")
    sys.exit(status)


def _is_interruption(error: BaseException | None) -> bool:
    """Whether it is an interrupt, or an error caused by one while a C library was imported."""
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
    """Write the traceback to a file and return its name."""
    text = "".join(traceback.format_exception(error))
    try:
        return str(keep_elsewhere(text, ".txt"))
    except OSError as failure:
        return f"what you did (the traceback could not be written: {why(failure)})"
