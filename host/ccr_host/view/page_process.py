"""The process that draws a live run."""

from __future__ import annotations

import multiprocessing
import queue
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path

from viser import ViserServer

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import CcrError, full_text
from ccr_host.record.log.play import play_run
from ccr_host.view.address import Door
from ccr_host.view.buttons import SharedButtons
from ccr_host.view.feed import Batch, RunEnded, play
from ccr_host.view.history import RunHistory
from ccr_host.view.page import Page
from ccr_host.view.page_server import in_servers_thread, page_server

DRAW_EVERY_S = 0.05


def draw_live_run(
    door: Door,
    messages: multiprocessing.Queue[Batch | RunEnded],
    buttons: SharedButtons,
    tell: Connection,
) -> None:
    """Serve the page until the run's process ends this one, or dies.

    Tells an empty text once the page is served, then what cannot be drawn.
    """
    with page_server(door) as server:
        tell.send("")
        _draw_on(server, _LiveRun(messages), buttons, tell)


def _draw_on(server: ViserServer, live: _LiveRun, buttons: SharedButtons, tell: Connection) -> None:
    run = multiprocessing.parent_process()
    assert run is not None
    clock = RealClock()
    drawn_us = clock.now_us()
    page: Page | None = None
    has_failed = False
    while not wait([run.sentinel], DRAW_EVERY_S):
        has_ended = live.take_in()
        now_us = clock.now_us()
        if page is None:
            if live.history.setup is not None:
                shown = None if has_ended else buttons
                page = in_servers_thread(server, Page, server, live.history, shown)
        elif has_ended:
            in_servers_thread(server, page.become_player, live.history)
        elif server.get_clients():
            try:
                elapsed_us = now_us - drawn_us
                in_servers_thread(server, page.draw, now_us, elapsed_us, live.dropped_batches)
            except TimeoutError:
                raise
            except Exception as error:  # the next attempt may succeed, and the buttons still work
                if not has_failed:
                    tell.send(f"drawing has failed, perhaps not only now: {full_text(error)}")
                has_failed = True
        drawn_us = now_us


class _LiveRun:
    """Takes in what the feed hands on."""

    def __init__(self, messages: multiprocessing.Queue[Batch | RunEnded]) -> None:
        self._messages = messages
        self.history = RunHistory()
        self.dropped_batches = 0

    def take_in(self) -> bool:
        """All that has come; whether the run has ended with it."""
        while True:
            try:
                message = self._messages.get_nowait()
            except queue.Empty:
                return False
            if isinstance(message, RunEnded):
                self._complete(message.folder)
                return True
            play(message.items, self.history)
            self.dropped_batches = message.dropped_batches

    def _complete(self, folder: Path) -> None:
        """Fill the gaps that a lagging page has left, if the log can be read."""
        complete = RunHistory()
        with suppress(CcrError):
            play_run(folder, complete)
            self.history = complete
