"""The command ``ccr-host doctor``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.commands.options import JsonOption, Without, console_beside, print_json
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from rich.console import Console

    from ccr_host.tools.checks import Finding

_COLOURS = {"good": "green", "warning": "yellow", "failure": "bold red"}


def doctor(
    rig: Annotated[RigOptions, Without("plant", "realtime")],
    blink: Annotated[
        bool, typer.Option("--blink", help="Blink the board's LED, to find it among others.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check computer, board and tracker. Reports what is wrong and what to do; nothing moves.

    Example: ccr-host doctor --device serial:/dev/ttyACM0 --tracker ndi:/dev/ttyUSB0
    """
    from ccr_host.tools.checks import exit_status
    from ccr_host.tools.doctor import examine

    findings = list(printed(examine(rig, Path(), blink=blink), console_beside(as_json=as_json)))
    if as_json:
        print_json({"findings": [finding.as_summary() for finding in findings]})
    if status := exit_status(findings):
        raise typer.Exit(status)


def printed(findings: Iterable[Finding], screen: Console) -> Iterator[Finding]:
    """Print each finding as it arrives, and yield it."""
    for finding in findings:
        severity = finding.severity.name.lower()
        screen.print(f"{severity:8}", style=_COLOURS[severity], end="")
        screen.print(f"{finding.subject}: {finding.text}")
        if finding.remedy:
            screen.print(f"{'':8}-> {finding.remedy}")
        yield finding
