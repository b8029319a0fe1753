"""Command line: joins the commands; whatever goes wrong is one line and an exit status."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import NoReturn

import typer

from ccr_host.commands.calibrate import calibrate
from ccr_host.commands.compare import compare
from ccr_host.commands.doctor import doctor
from ccr_host.commands.emulate import emulate
from ccr_host.commands.export import export
from ccr_host.commands.flash import flash
from ccr_host.commands.jog import jog
from ccr_host.commands.monitor import monitor
from ccr_host.commands.register import register
from ccr_host.commands.replay import replay
from ccr_host.commands.report import report
from ccr_host.commands.sweep import sweep
from ccr_host.commands.track import track
from ccr_host.commands.view import view
from ccr_host.commands.view_option import with_default_address
from ccr_host.commands.workspace import workspace
from ccr_host.errors import CcrError

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="ccr-host",
    help="Control of tendon-driven continuum robots; without hardware on a digital twin.",
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


def main() -> None:
    """Entry point of ``ccr-host``: whatever goes wrong is one line on standard error."""
    words = with_default_address(sys.argv[1:])
    try:
        status = app(words or ["--help"], prog_name="ccr-host", standalone_mode=False)
    except typer.TyperException as error:
        _leave(f"error: {error.format_message()} See ccr-host --help.", EXIT_USAGE)
    except CcrError as error:
        cure = f"; {error.cure}" if error.cure else ""
        _leave(f"error: {error.cause}{cure}", error.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        status = EXIT_INTERRUPTED
    if status == EXIT_INTERRUPTED:
        # Typer turns Ctrl-C into this status without a word.
        _leave("interrupted", EXIT_INTERRUPTED)
    sys.exit(status)


def _leave(message: str, status: int) -> NoReturn:
    # The terminal may be gone, which must not change the status.
    with suppress(OSError):
        sys.stderr.write(f"ccr-host: {message}\n")
        sys.stderr.flush()
    sys.exit(status)
