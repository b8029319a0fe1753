"""A recorded run in the browser."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from ccr_host.run.clock import RealClock
from ccr_host.run.log.play import play_run
from ccr_host.view.address import ViewAddress, open_door
from ccr_host.view.history import RunHistory
from ccr_host.view.page import Page
from ccr_host.view.page_process import DRAW_EVERY_S
from ccr_host.view.page_server import in_servers_thread, page_server


def show_recorded_run(folder: Path, address: ViewAddress, on_ready: Callable[[str], None]) -> None:
    """Serve the page until interrupted.

    Args:
        folder: of the run.
        address: to listen on.
        on_ready: is told the address to open.

    Raises:
        ConfigError: no run that can be read, or an address that cannot be had.
        KeyboardInterrupt: the usual end.
    """
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
