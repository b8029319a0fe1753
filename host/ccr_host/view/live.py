"""The live page as a run's own process sees it."""

from __future__ import annotations

import multiprocessing
import queue
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from ccr_host.errors import CcrError, ConfigError
from ccr_host.stop_signals import interruptible_again
from ccr_host.view.address import ViewAddress
from ccr_host.view.buttons import PageOperator, SharedButtons
from ccr_host.view.feed import Batch, RunEnded, ViewFeed

_ROOM_BATCHES = 64
"""Two and a half seconds of a run in real time."""
_START_TIMEOUT_S = 30.0
_END_TIMEOUT_S = 2.0


@dataclass(frozen=True)
class LivePage:
    """A page that waits for a run."""

    url: str
    feed: ViewFeed
    operator: PageOperator
    _messages: multiprocessing.Queue[Batch | RunEnded]
    _process: BaseProcess

    def end_run(self, folder: Path) -> None:
        """From now on the page plays what the folder holds."""
        with suppress(queue.Full):
            self._messages.put(RunEnded(folder), timeout=_END_TIMEOUT_S)

    def wait_until_interrupted(self) -> None:
        """Keep the page until Ctrl-C or the end of its process."""
        with suppress(KeyboardInterrupt), interruptible_again():
            self._process.join()


@contextmanager
def live_page(address: ViewAddress, *, realtime: bool) -> Iterator[LivePage]:
    """Serve a page from a process of its own; it ends with the context.

    Args:
        address: to listen on.
        realtime: whether the run's clock goes with the wall clock.

    Raises:
        ConfigError: the address cannot be had, or the package that draws is missing.
    """
    require_viser()
    context = multiprocessing.get_context("spawn")
    messages: multiprocessing.Queue[Batch | RunEnded] = context.Queue(maxsize=_ROOM_BATCHES)
    buttons = SharedButtons(context)
    told, tell = context.Pipe(duplex=False)
    process = context.Process(
        target=_draw_live_run, args=(address, messages, buttons, tell), daemon=True
    )
    process.start()
    tell.close()
    try:
        url = _address_told(told)
        feed = ViewFeed(lambda batch: _put(messages, batch), realtime=realtime)
        yield LivePage(url, feed, PageOperator(buttons, process.is_alive), messages, process)
    finally:
        messages.cancel_join_thread()
        process.terminate()
        process.join()


def require_viser() -> None:
    """Make sure that the page can be drawn.

    Raises:
        ConfigError: the package is not installed.
    """
    if find_spec("viser") is None:
        raise ConfigError(
            "--view: the package viser is not installed", 'pip install "ccr-host[view]"'
        )


def _draw_live_run(
    address: ViewAddress,
    messages: multiprocessing.Queue[Batch | RunEnded],
    buttons: SharedButtons,
    tell: Connection,
) -> None:
    from ccr_host.view.page_process import draw_live_run  # noqa: PLC0415 - viser is big, and only here

    draw_live_run(address, messages, buttons, tell)


def _address_told(told: Connection) -> str:
    try:
        if told.poll(_START_TIMEOUT_S):
            answer = told.recv()
            if isinstance(answer, tuple):
                raise ConfigError(*answer)
            return str(answer)
    except EOFError:
        pass
    raise CcrError("the live page did not start", "run without --view, or try again")


def _put(messages: multiprocessing.Queue[Batch | RunEnded], batch: Batch) -> bool:
    try:
        messages.put_nowait(batch)
    except queue.Full:
        return False
    return True
