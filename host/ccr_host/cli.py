"""Command line: joins the commands; whatever goes wrong is one line and an exit status."""

from __future__ import annotations

import sys
import tempfile
import traceback
from typing import Annotated, NoReturn

import typer

from ccr_host import __version__
from ccr_host.commands.calibrate import calibrate
from ccr_host.commands.compare import compare
from ccr_host.commands.doctor import doctor
from ccr_host.commands.emulate import emulate
from ccr_host.commands.export import export
from ccr_host.commands.flash import flash
from ccr_host.commands.jog import jog
from ccr_host.commands.monitor import monitor
from ccr_host.commands.output import keep_streams_writable, lost_output, warn
from ccr_host.commands.register import register
from ccr_host.commands.replay import replay
from ccr_host.commands.report import report
from ccr_host.commands.sweep import sweep
from ccr_host.commands.track import track
from ccr_host.commands.view import view
from ccr_host.commands.view_option import with_default_address
from ccr_host.commands.workspace import workspace
from ccr_host.errors import CcrError, CodeError
from ccr_host.stop_signals import stop_signals_interrupt

EXIT_USAGE = 2
EXIT_DEFECT = 3
"""Nothing that the user could correct, as with a device that fails."""
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="ccr-host",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS = (
    *(track, compare, workspace, sweep),
    *(doctor, flash, calibrate, register, jog, monitor, emulate),
    *(view, replay, report, export),
)
for command in _COMMANDS:
    app.command()(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"ccr-host {__version__}")
        raise typer.Exit


@app.callback()
def options_of_all(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Control of tendon-driven continuum robots; without hardware on a digital twin."""


def main() -> NoReturn:
    """Entry point of ``ccr-host``: whatever goes wrong is one line on standard error."""
    keep_streams_writable()
    words = with_default_address(sys.argv[1:])
    error: BaseException | None = None
    try:
        with stop_signals_interrupt():
            status = app(words or ["--help"], prog_name="ccr-host", standalone_mode=False)
        # Typer turns Ctrl-C into this status without a word.
        error = KeyboardInterrupt() if status == EXIT_INTERRUPTED else None
    except BaseException as caught:
        error = caught
    if error is not None:
        status, message = _verdict(error)
        if message:
            warn(message)
            sys.stderr.write(error.traceback if isinstance(error, CodeError) else "")
    sys.stdout.flush()
    if why := lost_output():
        warn(f"standard output is incomplete: {why}")
    sys.exit(status)


def _verdict(error: BaseException) -> tuple[int, str]:
    """Exit status and message."""
    match error:
        case typer.TyperException():
            return EXIT_USAGE, f"error: {error.format_message()} See ccr-host --help."
        case CcrError():
            cure = f"; {error.cure}" if error.cure else ""
            return error.exit_status, f"error: {error.cause}{cure}"
        case KeyboardInterrupt() | typer.Abort():
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
