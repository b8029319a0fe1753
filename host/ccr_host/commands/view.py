"""The command ``ccr-host view``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from ccr_host.view.address import DEFAULT_ADDRESS


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder that a run has left behind.")],
    address: Annotated[
        str, typer.Option("--address", metavar="HOST:PORT", help="Where the page is served.")
    ] = DEFAULT_ADDRESS,
) -> None:
    """Play a recorded run in the browser: scrub, pause, change the speed. Ctrl-C ends it.

    Example: ccr-host view runs/20260101-120000-8shape-adaptive
    """
    from ccr_host.view.address import parse_view_address
    from ccr_host.view.live import require_viser

    where = parse_view_address(address, "--address")
    require_viser()
    from ccr_host.run.log.reader import RunRecording
    from ccr_host.view.replay_page import show_recorded_run

    if trouble := RunRecording(run).end.trouble:
        typer.echo(trouble, err=True)
    with suppress(KeyboardInterrupt):
        show_recorded_run(run, where, lambda url: typer.echo(f"open {url}; Ctrl-C ends", err=True))
