"""The command ``ccr-host view``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.view import DEFAULT_ADDRESS

if TYPE_CHECKING:
    from ccr_host.view.live import ViewAddress

ViewOption = Annotated[
    str | None,
    typer.Option(
        "--view",
        metavar="[HOST:PORT]",
        help=f"Show the run live in the browser; {DEFAULT_ADDRESS} by default.",
    ),
]


def with_default_address(words: Sequence[str]) -> list[str]:
    """Add the default address to a ``--view`` without HOST:PORT."""
    return [
        f"--view={DEFAULT_ADDRESS}"
        if word == "--view" and not _is_like_an_address(following)
        else word
        for word, following in pairwise([*words, ""])
    ]


def _is_like_an_address(word: str) -> bool:
    return word.startswith("[") or (":" in word and word.rpartition(":")[2].isdigit())


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    address: Annotated[
        str, typer.Option("--address", metavar="HOST:PORT", help="Address to serve the page on.")
    ] = DEFAULT_ADDRESS,
) -> None:
    """Play a recorded run in the browser. Scrub, pause, change the speed; Ctrl-C ends it.

    Example: ccr-host view runs/20260101-120000-8shape-adaptive
    """
    from ccr_host.view.live import parse_view_address, require_viser

    where = parse_view_address(address, "--address")
    require_viser()
    from ccr_host.record.log.reader import RunRecording

    if trouble := RunRecording(run).end.trouble:
        typer.echo(trouble, err=True)
    with suppress(KeyboardInterrupt):
        _show_recorded_run(run, where, lambda url: typer.echo(f"open {url}; Ctrl-C ends", err=True))


def _show_recorded_run(folder: Path, address: ViewAddress, on_ready: Callable[[str], None]) -> None:
    """Serve the page until interrupted.

    Raises:
        ConfigError: the run cannot be read, or the address cannot be used.
        KeyboardInterrupt: the normal end.
    """
    import threading

    from ccr_host.core.clock import RealClock
    from ccr_host.record.log.reader import play_run
    from ccr_host.view.history import RunHistory
    from ccr_host.view.live import open_door
    from ccr_host.view.page import Page
    from ccr_host.view.page_server import DRAW_EVERY_S, in_servers_thread, page_server

    history = RunHistory()
    play_run(folder, history)
    pace, clock = threading.Event(), RealClock()
    door = open_door(address)
    on_ready(door.url)
    with page_server(door) as server:
        page = in_servers_thread(server, Page, server, history, None)
        drawn_us = clock.now_us()
        while not pace.wait(DRAW_EVERY_S):
            now_us = clock.now_us()
            if server.get_clients():
                in_servers_thread(server, page.draw, now_us, now_us - drawn_us, 0)
            drawn_us = now_us
