"""The live page as a run's own process sees it."""

from __future__ import annotations

import multiprocessing
import queue
import secrets
import signal
import socket
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock, Thread
from typing import TypeAlias

from ccr_host.core.addresses import host_and_port, joined, listening_socket
from ccr_host.core.errors import CcrError, ConfigError, full_text
from ccr_host.core.standard_streams import warn
from ccr_host.core.stop_signals import cause_of_death, interruptible_again
from ccr_host.view import DEFAULT_ADDRESS
from ccr_host.view.feed import Batch, PageOperator, RunEnded, SharedButtons, ViewFeed

_ROOM_BATCHES = 64
"""Two and a half seconds of a run in real time."""
_START_TIMEOUT_S = 30.0
_SILENT_S = 60.0
"""A page that is silent for this long hangs: it reports each second, except during long drawings,
and takes 20 s to start on a machine under load."""
_END_TIMEOUT_S = 2.0
_MOST_STARTS = 10
_TOKEN_BYTES = 16

_Messages: TypeAlias = "multiprocessing.Queue[Batch | RunEnded]"


@dataclass(frozen=True)
class ViewAddress:
    """Host and port to listen on; port 0 takes a free one."""

    host: str
    port: int


@dataclass(frozen=True)
class Door:
    """A socket that listens, and what a visitor must know; goes to the process that serves."""

    host: str
    """Host as the user wrote it."""
    listening: socket.socket
    token: str

    @property
    def url(self) -> str:
        """What to open in a browser."""
        return f"http://{joined(self.host, self.listening.getsockname()[1])}/{self.token}"


def open_door(address: ViewAddress) -> Door:
    """Listen, with a new secret.

    Raises:
        ConfigError: the address cannot be had.
    """
    listening = listening_socket(address.host, address.port)
    return Door(address.host, listening, secrets.token_urlsafe(_TOKEN_BYTES))


def parse_view_address(text: str, option: str = "--view") -> ViewAddress:
    """Read ``HOST:PORT``; IPv6 in brackets.

    ``option`` is what it was given with, for messages.

    Raises:
        ConfigError: it is not one.
    """
    return ViewAddress(*host_and_port(text, f"{option} {text}", f"{option} {DEFAULT_ADDRESS}", 0))


class LivePage:
    """A page that waits for a run, in a process that is started again when it dies or hangs.

    Raises:
        CcrError: the page does not start.
    """

    def __init__(self, door: Door, *, realtime: bool) -> None:
        self._door = door
        self._context = multiprocessing.get_context("spawn")
        self._buttons = SharedButtons(self._context)
        self._ended: RunEnded | None = None
        self._is_wanted = True
        self._heard: deque[str] = deque()
        self._changing = Lock()
        self.url = door.url
        self.feed = ViewFeed(self._put, realtime=realtime)
        told = self._start()
        if (trouble := _trouble_at_start(told)) is not None:
            self._process.kill()
            door.listening.close()
            raise CcrError(f"the live page did not start{trouble}", "run without --view")
        self._keeper = Thread(target=self._keep, args=(told,), daemon=True, name="live page")
        self._keeper.start()
        self.operator = PageOperator(self._buttons, self._keeper.is_alive, self._heard)

    def end_run(self, folder: Path) -> None:
        """Switch the page to playing what the folder holds."""
        with self._changing:
            self._ended, messages = RunEnded(folder), self._messages
        with suppress(queue.Full):
            messages.put(self._ended, timeout=_END_TIMEOUT_S)

    def wait_until_interrupted(self) -> None:
        """Keep the page until Ctrl-C, or until it cannot be kept."""
        with suppress(KeyboardInterrupt), interruptible_again():
            self._keeper.join()

    def close(self) -> None:
        """End the page, even one that hangs."""
        with self._changing:
            self._is_wanted = False
            self._process.kill()
        self._keeper.join()
        self._door.listening.close()

    def _put(self, batch: Batch) -> bool:
        with self._changing, suppress(queue.Full):
            self._messages.put_nowait(batch)
            return True
        return False

    def _start(self) -> Connection:
        """Start a process and let it know where the run stands; what it tells."""
        messages: _Messages = self._context.Queue(maxsize=_ROOM_BATCHES)
        messages.cancel_join_thread()
        told, tell = self._context.Pipe(duplex=False)
        arguments = (self._door, messages, self._buttons, tell)
        process = self._context.Process(target=_draw_live_run, args=arguments, daemon=True)
        process.start()
        tell.close()
        with self._changing:
            self._messages, self._process = messages, process
            messages.put(self._ended or self.feed.resumed())
            if not self._is_wanted:
                process.kill()
        return told

    def _keep(self, told: Connection) -> None:
        """Hear what the process tells, and start another one whenever it dies or hangs."""
        for start in range(1, _MOST_STARTS + 1):
            hangs = False
            with suppress(EOFError, OSError):
                while told.poll(_SILENT_S):
                    if trouble := told.recv():
                        self._tell(f"the live page: {trouble}")
                hangs = True
                self._process.kill()
            self._process.join()
            if not self._is_wanted:
                return
            died = f"has died ({cause_of_death(self._process.exitcode)})"
            lost = f"the live page {'hangs' if hangs else died} and "
            if start == _MOST_STARTS:
                self._tell(lost + "stays away; only Ctrl-C in the terminal is left")
                return
            self._tell(lost + "is started again; Ctrl-C in the terminal works as ever")
            told = self._start()

    def _tell(self, text: str) -> None:
        warn(text)
        self._heard.append(text)


@contextmanager
def live_page(address: ViewAddress, *, realtime: bool) -> Iterator[LivePage]:
    """Serve a page from a separate process, which ends with the context.

    Raises:
        ConfigError: the address cannot be had, or the package that draws is missing.
        CcrError: the page does not start.
    """
    require_viser()
    page = LivePage(open_door(address), realtime=realtime)
    try:
        yield page
    finally:
        page.close()


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
    door: Door, messages: _Messages, buttons: SharedButtons, tell: Connection
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C means the run, which ends this process
    try:
        from ccr_host.view.page_server import draw_live_run  # noqa: PLC0415 - 0.2 s of viser, for this process alone

        draw_live_run(door, messages, buttons, tell)
    except Exception as error:
        with suppress(OSError):  # The run may be gone.
            tell.send(full_text(error))
        sys.exit(1)


def _trouble_at_start(told: Connection) -> str | None:
    """None once the page is served."""
    with suppress(EOFError):
        if told.poll(_START_TIMEOUT_S):
            trouble = str(told.recv())
            return f": {trouble}" if trouble else None
    return ""
