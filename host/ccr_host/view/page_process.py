"""The process that draws a live run."""

from __future__ import annotations

import multiprocessing
import queue
import signal
from multiprocessing.connection import Connection, wait
from pathlib import Path

from viser import ViserServer

from ccr_host.errors import CcrError
from ccr_host.run.clock import RealClock
from ccr_host.run.log.play import play_run
from ccr_host.view.address import ViewAddress
from ccr_host.view.buttons import SharedButtons
from ccr_host.view.feed import Batch, RunEnded, play
from ccr_host.view.history import RunHistory
from ccr_host.view.page import Page
from ccr_host.view.page_server import page_server

DRAW_EVERY_S = 0.05


def draw_live_run(
    address: ViewAddress,
    messages: multiprocessing.Queue[Batch | RunEnded],
    buttons: SharedButtons,
    tell: Connection,
) -> None:
    """Serve the page until the run's process ends this one, or dies.

    Tells the address to open, or the cause and the cure of the error that prevents it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C means the run, which ends this process
    try:
        with page_server(address) as (server, url):
            tell.send(url)
            _draw_on(server, messages, buttons)
    except CcrError as error:
        tell.send((error.cause, error.cure))


def _draw_on(
    server: ViserServer,
    messages: multiprocessing.Queue[Batch | RunEnded],
    buttons: SharedButtons,
) -> None:
    run = multiprocessing.parent_process()
    assert run is not None
    clock = RealClock()
    drawn_us = clock.now_us()
    live = _LiveRun(messages)
    page: Page | None = None
    while not wait([run.sentinel], DRAW_EVERY_S):
        ended = live.take_in()
        if page is None and live.history.setup is not None:
            page = Page(server, live.history, buttons)
        if page is not None and ended is not None:
            page.become_player(_complete(live.history, ended.folder))
        now_us = clock.now_us()
        if page is not None and server.get_clients():
            page.draw(now_us, now_us - drawn_us, live.dropped_batches)
        drawn_us = now_us


class _LiveRun:
    """Takes in what the feed hands on."""

    def __init__(self, messages: multiprocessing.Queue[Batch | RunEnded]) -> None:
        self._messages = messages
        self.history = RunHistory()
        self.dropped_batches = 0

    def take_in(self) -> RunEnded | None:
        """All that has come; whether the run has ended with it."""
        while True:
            try:
                message = self._messages.get_nowait()
            except queue.Empty:
                return None
            if isinstance(message, RunEnded):
                return message
            play(message.items, self.history)
            self.dropped_batches = message.dropped_batches


def _complete(seen: RunHistory, folder: Path) -> RunHistory:
    """The run without the gaps that a lagging page has left; what was seen if that fails."""
    complete = RunHistory()
    try:
        play_run(folder, complete)
    except CcrError:
        return seen
    return complete
