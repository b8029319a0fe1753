"""The process that draws: viser's server, on a socket of ours, for visitors who know the token.

viser itself requires no authentication, listens on a port that it chooses, and sets any property of
a control that a message names. All of this passes through one function of `websockets`, which is
replaced here while viser starts.
"""

from __future__ import annotations

import asyncio
import hmac
import multiprocessing
import os
import queue
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import replace
from http import HTTPStatus
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, ParamSpec, TypeAlias, TypeVar
from unittest.mock import patch

import msgspec
import websockets.asyncio.server
from viser import ViserServer
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.http11 import Request, Response

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import CcrError, full_text
from ccr_host.record.log.reader import play_run
from ccr_host.view.feed import Batch, RunEnded, SharedButtons, play
from ccr_host.view.history import RunHistory
from ccr_host.view.live import Door
from ccr_host.view.page import Page

DRAW_EVERY_S = 0.05
_LONGEST_MESSAGE_BYTES = 4096
_HANGS_AFTER_S = 30.0
_TELL_EVERY_US = 1_000_000
_PATIENCE = b"""<script>
const repeated = window.setInterval;
window.setInterval = (run, ms, ...more) => repeated(run, ms === 1000 ? 6000 : ms, ...more);
</script>"""
"""The page drops an attempt to connect that has not succeeded within a second. After some thirty
Chrome delays each by 1 to 5 s, and none succeeds any more."""

P = ParamSpec("P")
T = TypeVar("T")


class _Camera(msgspec.Struct, tag="ViewerCameraMessage", forbid_unknown_fields=True):
    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    image_height: int
    image_width: int
    fov: float
    near: float
    far: float
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]


class _Value(msgspec.Struct, forbid_unknown_fields=True):
    value: bool | float | str


class _Control(msgspec.Struct, tag="GuiUpdateMessage", forbid_unknown_fields=True):
    uuid: str
    updates: _Value


_SAID_BY_A_PAGE = msgspec.msgpack.Decoder(_Camera | _Control)
"""Where the visitor looks from, and the new value of a control: a button, a box, the slider."""


_Data: TypeAlias = Any
"""Bytes in fact; the method has overloads, and only this type fits them all."""


class _Visitor(ServerConnection):
    """Passes on what a page says, as it was understood here; all else is dropped."""

    async def recv(self, decode: bool | None = None) -> _Data:
        while True:
            message = await super().recv(decode=False)
            with suppress(msgspec.MsgspecError):
                return msgspec.msgpack.encode(_SAID_BY_A_PAGE.decode(message))


class _Guarded:
    """`serve`, but on the socket that is already listening, and only for admitted visitors."""

    server: Server | None = None
    """Not serving yet: connections that arrive while viser starts are held by the door."""

    def __init__(self, door: Door) -> None:
        self._door = door

    def __call__(
        self,
        handler: Callable[[ServerConnection], Awaitable[None]],
        *_: object,
        process_request: Callable[[ServerConnection, Request], Response | None],
        **options: object,
    ) -> serve:
        token = self._door.token

        def judge(visitor: ServerConnection, request: Request) -> Response | None:
            if not _is_admitted(request, token):
                return visitor.respond(HTTPStatus.FORBIDDEN, "Open the address that was printed.\n")
            behind = request.path.removeprefix(f"/{token}")
            headers = request.headers.copy()
            headers.pop("Accept-Encoding", None)  # what comes packed cannot be changed
            asked = replace(request, path=behind, headers=headers)
            return _patient(process_request(visitor, asked))

        ours: dict[str, Any] = {
            **options,
            "sock": self._door.listening,
            "start_serving": False,
            "process_request": judge,
            "create_connection": _Visitor,
            "max_size": _LONGEST_MESSAGE_BYTES,
        }
        serving = serve(handler, **ours)
        self.server = serving.server
        return serving


def _patient(answer: Response | None) -> Response | None:
    """The answer, with ``_PATIENCE`` if it is the page itself."""
    if answer is not None and answer.body.startswith(b"<!doctype html>"):
        answer.body = answer.body.replace(b"<head>", b"<head>" + _PATIENCE, 1)
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer


def _is_admitted(request: Request, token: str) -> bool:
    """Whether a request shows the token and comes from no other site's page."""
    shown = request.path.partition("?")[0].split("/")[1:2]
    if not hmac.compare_digest("".join(shown).encode(), token.encode()):
        return False
    origin = request.headers.get("Origin")
    return origin is None or origin.partition("://")[2] == request.headers.get("Host")


@contextmanager
def page_server(door: Door) -> Iterator[ViserServer]:
    """Serve an empty page. What viser and its visitors give cause to print is not shown.

    Raises:
        CcrError: viser does not serve through the door.
    """
    guarded = _Guarded(door)
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        with patch.object(websockets.asyncio.server, "serve", guarded):
            viser = ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            if guarded.server is None:
                raise CcrError(
                    "this version of viser cannot be guarded: it opens another port",
                    'pip install "viser==1.1.*"',
                )
            starting = guarded.server.start_serving()
            asyncio.run_coroutine_threadsafe(starting, viser.get_event_loop()).result()
            yield viser
        finally:
            viser.stop()


def in_servers_thread(
    server: ViserServer, work: Callable[P, T], *given: P.args, **named: P.kwargs
) -> T:
    """Do what changes the page where its messages are sent: viser's events know one thread.

    Raises:
        TimeoutError: the server hangs.
    """

    async def do() -> T:
        return work(*given, **named)

    return asyncio.run_coroutine_threadsafe(do(), server.get_event_loop()).result(_HANGS_AFTER_S)


def draw_live_run(
    door: Door,
    messages: multiprocessing.Queue[Batch | RunEnded],
    buttons: SharedButtons,
    tell: Connection,
) -> None:
    """Serve the page until the run's process ends this one, or dies.

    Tells an empty text once the page is served and each second from then on, and what cannot be
    drawn.
    """
    with page_server(door) as server:
        tell.send("")
        _draw_on(server, _LiveRun(messages), buttons, tell)


def _draw_on(server: ViserServer, live: _LiveRun, buttons: SharedButtons, tell: Connection) -> None:
    run = multiprocessing.parent_process()
    assert run is not None
    clock = RealClock()
    drawn_us = told_us = clock.now_us()
    page: Page | None = None
    has_failed = False
    while not wait([run.sentinel], DRAW_EVERY_S):
        has_ended = live.take_in()
        now_us = clock.now_us()
        if now_us - told_us > _TELL_EVERY_US:
            told_us = now_us
            tell.send("")
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
