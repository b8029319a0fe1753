"""viser behind our door: who comes in, and what they may say."""

from __future__ import annotations

import multiprocessing
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viser import ViserServer
from viser.infra import Message, WebsockServer
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.exceptions import InvalidStatus

from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.run.execute import execute
from ccr_host.run.options import RunOptions
from ccr_host.view import page_server as module
from ccr_host.view.feed import SharedButtons
from ccr_host.view.history import RunHistory
from ccr_host.view.live import Door, ViewAddress, open_door
from ccr_host.view.page import Page
from ccr_host.view.page_server import in_servers_thread, page_server
from tests.patience import PATIENCE_S
from tests.viewer import CAMERA, Viewer


@contextmanager
def served(host: str = "127.0.0.1") -> Iterator[tuple[Door, ViserServer]]:
    door = open_door(ViewAddress(host, 0))
    with page_server(door) as server:
        yield door, server


class Stop:
    """A button as the page's."""

    def __init__(self, server: ViserServer) -> None:
        self.pressed = threading.Event()
        in_servers_thread(server, self._add, server)

    def _add(self, server: ViserServer) -> None:
        self.button = server.gui.add_button("STOP")
        self.box = server.gui.add_checkbox("box", initial_value=False)
        self.slider = server.gui.add_slider("slider", 0.0, 1.0, 0.1, 0.5)

        @self.button.on_click
        async def _(_: object) -> None:
            self.pressed.set()


def status_of(url: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def test_a_page_whose_server_is_slow_to_start_waits_for_it_instead_of_trying_each_second() -> None:
    """Chrome puts off the attempts of a page that has tried in vain for half a minute."""
    with served() as (door, _):
        packed = urllib.request.Request(door.url, headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(packed) as answer:
            page, length = answer.read().decode(), int(answer.headers["Content-Length"])
    assert length == len(page.encode())
    assert page.index("ms === 1000 ? 6000") < page.index("<script data-p")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "0.0.0.0"])
def test_only_the_address_with_its_token_opens_the_page(host: str) -> None:
    with served(host) as (door, server):
        Stop(server)
        assert status_of(door.url) == status_of(f"{door.url}/") == 200
        bare = door.url.removesuffix(door.token)
        for url in (bare, f"{bare}?token={door.token}", f"{bare}x", f"{door.url}x", f"{bare}/x"):
            assert status_of(url) == 403, url
            with pytest.raises(InvalidStatus, match="403"):
                Viewer(url)
        with Viewer(door.url) as viewer:
            assert viewer.control("STOP")


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "", "://"])
def test_another_sites_page_is_refused_though_it_knew_the_token(origin: str) -> None:
    with served() as (door, _):
        assert status_of(door.url, Origin=origin) == 403
        with pytest.raises(InvalidStatus, match="403"):
            Viewer(door.url, Origin=origin)


def test_a_tunnel_may_change_host_and_port() -> None:
    with served() as (door, _):
        assert status_of(door.url, Origin="http://robot-pc:9", Host="robot-pc:9") == 200


def test_every_token_is_another() -> None:
    tokens = {open_door(ViewAddress("127.0.0.1", 0)).token for _ in range(3)}
    assert len(tokens) == 3
    assert all(len(token) >= 20 for token in tokens)


HOSTILE: list[Any] = [
    b"", b"\xc1", b"\x00" * 100, "text", b"\x91" * 4000, b"x" * 4096,
    {}, [], {"type": None}, {"type": "NoMessage"}, {"type": "Message"},
    {"type": "ShareUrlRequest"}, {"type": "GuiCloseModalMessage", "uuid": "x"},
    {"type": "RunJavascriptMessage", "source": "1"}, {"type": "ResetGuiMessage"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "STOP", "transfer_uuid": "t",
     "filename": "f", "mime_type": "m", "part_count": 1, "size_bytes": 1 << 40},
    {**CAMERA, "position": "here"}, {**CAMERA, "position": (1.0,)}, {**CAMERA, "more": 1},
    {**CAMERA, "excluded_self_client": 0}, {"type": "ViewerCameraMessage"},
    {"type": "GuiUpdateMessage", "uuid": "STOP"},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"update_cb": []}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"value": True, "update_cb": []}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"removed": True}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"is_button": False}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"props": None}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"value": []}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": {"value": {}}},
    {"type": "GuiUpdateMessage", "uuid": "STOP", "updates": [["value", True]]},
    {"type": "GuiUpdateMessage", "uuid": 1, "updates": {"value": True}},
    {"type": "GuiUpdateMessage", "uuid": "nobody", "updates": {"value": True}},
    {"type": "GuiUpdateMessage", "uuid": "slider", "updates": {"value": "fast"}},
    {"type": "GuiUpdateMessage", "uuid": "slider", "updates": {"value": float("nan")}},
]  # fmt: skip


def test_no_message_but_a_value_changes_a_control_and_none_is_printed_about(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with served() as (door, server):
        stop = Stop(server)
        before = vars(stop.button._impl).copy()
        with Viewer(door.url) as viewer:
            uuids = {label: viewer.control(label) for label in ("STOP", "slider")}
            for message in HOSTILE:
                if isinstance(message, dict):
                    named = {"uuid": uuids.get(message.get("uuid"), message.get("uuid"))}
                    viewer.say(message | named if "uuid" in message else message)
                else:
                    viewer.say(message if isinstance(message, str) else packed(message))
            assert not stop.pressed.is_set()
            assert vars(stop.button._impl) == before
            viewer.set(uuids["STOP"], value=True)
            assert stop.pressed.wait(PATIENCE_S), "the same viewer can still stop the robot"
    assert capfd.readouterr() == ("", "")


def packed(message: Any) -> bytes:
    return message if isinstance(message, bytes) else msgspec.msgpack.encode(message)


@given(st.binary() | st.recursive(st.text() | st.floats() | st.none(), st.lists).map(packed))
@pytest.mark.long
def test_bytes_are_what_a_page_says_or_nothing(data: bytes) -> None:
    with suppress(msgspec.MsgspecError):
        assert isinstance(module._SAID_BY_A_PAGE.decode(data), module._Camera | module._Control)


@pytest.mark.parametrize(
    "garbage", [b"", b"\r\n\r\n", b"\x16\x03\x01\x02\x00", b"GET / HTTP/1.1\r\n", b"x" * 20_000]
)
def test_what_is_no_request_is_printed_about_neither(
    garbage: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    with served() as (door, _):
        with (
            suppress(ConnectionError),
            socket.create_connection(door.listening.getsockname()) as one,
        ):
            one.sendall(garbage)
            one.shutdown(socket.SHUT_WR)
            assert b"viser" not in one.recv(4096).lower()
        assert status_of(door.url) == 200
    assert capfd.readouterr() == ("", "")


def test_all_of_the_page_is_sent_from_the_servers_thread(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In any other thread, viser's event may fail with "deque mutated during iteration"."""
    (tmp_path / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,30\n2,10,35\n")
    history, threads = RunHistory(), set()
    execute(RunOptions(str(tmp_path / "short.csv"), "mpc"), history, lambda *_: None)
    push = AsyncMessageBuffer.push

    def pushed(buffer: AsyncMessageBuffer, message: Message) -> None:
        threads.add(threading.current_thread())
        push(buffer, message)

    with served() as (door, server):
        monkeypatch.setattr(AsyncMessageBuffer, "push", pushed)
        buttons = SharedButtons(multiprocessing.get_context("spawn"))
        page = in_servers_thread(server, Page, server, history, buttons)
        with Viewer(door.url) as viewer:
            viewer.press("Pause")
            viewer.press("STOP the robot")
            viewer.control("Stop sent")
            in_servers_thread(server, page.draw, 1_000_000, 0.0, 0)
            in_servers_thread(server, page.become_player, history)
            viewer.press("Play")
            viewer.set(viewer.control("ideal robot"), value=True)
            viewer.set(viewer.control("disks"), value=False)
            viewer.set(viewer.control("speed"), value="2")
            viewer.set(viewer.control("speed"), value="warp")
            viewer.set(viewer.control("time (s)"), value=1.0)
            for number in range(2, 20):
                in_servers_thread(server, page.draw, number * 1_000_000, 1e5, 0)
            viewer.control("Pause")
        assert len(threads) == 1
        assert threads != {threading.current_thread()}


def test_whoever_comes_while_the_page_is_made_waits_at_the_door(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    door, seen = open_door(ViewAddress("127.0.0.1", 0)), threading.Event()
    start = WebsockServer.start

    def look() -> None:
        with Viewer(door.url) as viewer:
            viewer.control("STOP")
            seen.set()

    def started_slowly(server: WebsockServer) -> None:
        start(server)
        threading.Thread(target=look, daemon=True).start()
        time.sleep(0.5)

    monkeypatch.setattr(WebsockServer, "start", started_slowly)
    with page_server(door) as server:
        Stop(server)
        assert seen.wait(PATIENCE_S)


def test_a_server_that_hangs_does_not_hang_who_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_HANGS_AFTER_S", 0.1)
    with served() as (_, server):
        released = threading.Event()
        server.get_event_loop().call_soon_threadsafe(released.wait)
        with pytest.raises(TimeoutError):
            in_servers_thread(server, released.is_set)
        released.set()


def test_a_viser_that_cannot_be_guarded_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.patch, "object", lambda *_: nullcontext())
    with pytest.raises(CcrError, match="opens another port"), served():
        pytest.fail("nobody is let in")


def test_a_port_that_is_taken_is_named() -> None:
    taken = open_door(ViewAddress("127.0.0.1", 0))
    number = taken.listening.getsockname()[1]
    with pytest.raises(ConfigError, match=f"cannot listen on 127.0.0.1:{number}: already in use"):
        open_door(ViewAddress("127.0.0.1", number))
