"""The command ``ccr-host report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands.options import console


def report(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, finished or not.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="HTML to write; by default report.html in the first run's folder."
        ),
    ] = None,
) -> None:
    """Write one HTML page about runs. Figures, table, faults, configuration; printable, too.

    Example: ccr-host report runs/20260101-120000-ellipse-adaptive
    """
    from ccr_host.core.user_file import is_folder
    from ccr_host.record.report import write_report

    first = runs[0] if is_folder(runs[0]) else runs[0].parent
    file = out or first / "report.html"
    screen = console()
    for run in write_report(runs, file):
        if run.log_trouble:
            screen.print(f"{run.folder}: {run.log_trouble}", soft_wrap=True)
    screen.print(f"written: {file}", soft_wrap=True)
