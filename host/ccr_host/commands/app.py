"""The application with all commands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import typer

from ccr_host.commands.calibrate import calibrate
from ccr_host.commands.compare import compare
from ccr_host.commands.doctor import doctor
from ccr_host.commands.emulate import emulate
from ccr_host.commands.export import export
from ccr_host.commands.flash import flash
from ccr_host.commands.identify import identify
from ccr_host.commands.jog import jog
from ccr_host.commands.monitor import monitor
from ccr_host.commands.options import with_rig_options
from ccr_host.commands.record import record
from ccr_host.commands.register import register
from ccr_host.commands.replay import replay
from ccr_host.commands.report import report
from ccr_host.commands.setup import setup
from ccr_host.commands.sweep import sweep
from ccr_host.commands.track import track
from ccr_host.commands.view import view, with_default_address
from ccr_host.commands.workspace import workspace
from ccr_host.core import __version__
from ccr_host.core.errors import ConfigError

app = typer.Typer(
    name="ccr-host",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS = (
    *(track, compare, workspace, sweep),
    *(setup, doctor, flash, calibrate, register, record, identify, jog, monitor, emulate),
    *(view, replay, report, export),
)
_WORDING = (
    (r"Input should be a valid integer.*", "not a whole number"),
    (r"Input should be a valid number.*", "not a number"),
    (r"Input should be greater than or equal to", "less than"),
    (r"Input should be less than or equal to", "more than"),
    (r"Input should be", "not"),
)
"""Wording of pydantic, and ours."""
for command in _COMMANDS:
    app.command()(with_rig_options(command))


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
    """Control of tendon-driven continuum robots, real or simulated."""


def _usage(error: typer.TyperException) -> str:
    """What is wrong with the words, in ours where pydantic checked them."""
    text = error.format_message().removesuffix(".").replace("Value error, ", "")
    for theirs, ours in _WORDING:
        text = re.sub(theirs, ours, text)
    return text


def _command_of(error: typer.TyperException, words: Sequence[str]) -> str:
    """The command whose help says more."""
    if (context := getattr(error, "ctx", None)) is not None:
        return str(context.command_path)
    # An option without its value is noticed before there is a context.
    known = {command.__name__ for command in _COMMANDS}
    return " ".join(["ccr-host", *(word for word in words[:1] if word in known)])


def run(words: Sequence[str]) -> int:
    """Run a command line and return the exit status.

    Raises:
        ConfigError: the words are not a valid command line.
        CcrError: raised by the command.
        KeyboardInterrupt: the command was interrupted.
    """
    try:
        status = app(
            with_default_address(words) or ["--help"], prog_name="ccr-host", standalone_mode=False
        )
    except typer.TyperException as error:
        raise ConfigError(_usage(error), f"see {_command_of(error, words)} --help") from None
    except typer.Abort:
        raise KeyboardInterrupt from None
    return int(status or 0)
