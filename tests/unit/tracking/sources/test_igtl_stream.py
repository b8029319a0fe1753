"""OpenIGTLink byte by byte: what a server sends over a real socket, and what is no server."""

import socket
import struct
import time

import numpy as np
import pytest

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import TrackerError
from ccr_host.tracking.sources.igtl import IgtlTracker
from ccr_host.tracking.sources.igtl_stream import IgtlStream, igtl_opener
from ccr_host.tracking.tracker import ForeignPeerError, wait_until_tracking
from tests.exposer import running
from tests.foreign_servers import FOREIGN, foreign_server
from tests.patience import PATIENCE_S

pyigtl = pytest.importorskip("pyigtl")


def packed(name: str, stamp_s: float = 1.0, metadata: dict[str, str] | None = None) -> bytes:
    message = pyigtl.TransformMessage(np.eye(4), device_name=name, timestamp=stamp_s)
    if metadata is not None:
        message.header_version = 2
        message.metadata = metadata
    return message.pack()


def raw(kind: bytes, body: bytes, length: int | None = None) -> bytes:
    count = len(body) if length is None else length
    return struct.pack("> H 12s 20s II Q Q", 1, kind, b"device", 1, 0, count, 0) + body


@pytest.fixture
def served():
    """A stream and the server's end of its connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        stream = igtl_opener("127.0.0.1", listener.getsockname()[1])()
        server, _ = listener.accept()
        with server:
            yield stream, server
        stream.close()


def received(stream: IgtlStream, count: int) -> list:
    messages = []
    deadline = time.monotonic() + PATIENCE_S
    while len(messages) < count and time.monotonic() < deadline:
        messages += stream.messages()
    return messages


def names(messages: list) -> list[str]:
    return [message.device_name for message in messages]


def test_messages_cut_anywhere_come_out_whole_and_all_of_them(served):
    stream, server = served
    data = b"".join(packed(f"M{i}ToTracker", i) for i in range(1, 9))
    messages = []
    for at in range(0, len(data), 37):
        server.sendall(data[at : at + 37])
        messages += stream.messages()
    messages += received(stream, 8 - len(messages))
    assert names(messages) == [f"M{i}ToTracker" for i in range(1, 9)]


def test_metadata_of_plus_come_with_the_transform(served):
    stream, server = served
    server.sendall(packed("M1ToTracker", 1.0, {"TransformStatus": "MISSING"}))
    (message,) = received(stream, 1)
    assert message.metadata == {"TransformStatus": "MISSING"}


def test_images_and_unknown_types_are_skipped_and_named(served):
    stream, server = served
    image = raw(b"IMAGE", bytes(3_000_000))
    server.settimeout(PATIENCE_S)
    messages = []
    for at in range(0, len(image), 100_000):
        server.sendall(image[at : at + 100_000])
        messages += stream.messages()
    server.sendall(raw(b"TDATA", b"abc") + raw(b"STATUS", b"") + packed("M1ToTracker"))
    messages += received(stream, 1)
    assert names(messages) == ["M1ToTracker"]
    assert stream.skipped_types == {"IMAGE", "TDATA", "STATUS"}


def test_damaged_body_costs_its_own_message_only(served):
    stream, server = served
    server.sendall(raw(b"TRANSFORM", b"short") + packed("M1ToTracker"))
    assert names(received(stream, 1)) == ["M1ToTracker"]
    assert stream.damaged == 1


@pytest.mark.parametrize(
    "data",
    [
        b"HTTP/1.1 200 OK\r\n",
        b"S",
        raw(b"transform", b""),
        raw(b"IMAGE", b"", length=1 << 40),
        b"\0\1" + bytes(60),
        b"\0\7TRANSFORM" + bytes(60),
    ],
)
def test_what_is_not_openigtlink_is_refused_with_what_was_sent(served, data):
    stream, server = served
    server.sendall(data)
    with pytest.raises(ForeignPeerError, match="does not speak OpenIGTLink"):
        received(stream, 1)


def test_closed_connection_is_told_after_the_last_message(served):
    stream, server = served
    server.sendall(packed("M1ToTracker"))
    server.close()
    assert names(received(stream, 1)) == ["M1ToTracker"]
    with pytest.raises(TrackerError, match="closed the connection"):
        received(stream, 1)


@pytest.mark.parametrize(
    ("host", "named"), [("127.0.0.1", "igtl://127.0.0.1:{}"), ("::1", "igtl://[::1]:{}")]
)
def test_nobody_there_is_told_at_once_and_where(host, named):
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(TrackerError, match="cannot be reached") as refusal:
        igtl_opener(host, port)()
    assert str(refusal.value).startswith(named.format(port))


@pytest.mark.long
@pytest.mark.parametrize("kind", [*FOREIGN, "hangs"])
def test_foreign_server_is_one_clear_error(kind, capfd):
    told = {
        "closes at once": "closed the connection, without sending anything",
        "silence": "something listens there, but sends nothing",
        "echo": "something listens there, but sends nothing",
        "hangs": "something listens there, but sends nothing",
    }.get(kind, "does not speak OpenIGTLink")
    patience_us = 3_500_000 if "listens" in told else PATIENCE_S * 1_000_000
    with foreign_server(kind) as port:
        clock = RealClock()
        tracker = IgtlTracker("127.0.0.1", port, expected_tools=("M1", "M2", "M3"))
        clock.attach(tracker)
        with running(tracker), pytest.raises(TrackerError) as refusal:
            wait_until_tracking(tracker, clock, timeout_us=patience_us)
    assert told in str(refusal.value)
    assert capfd.readouterr() == ("", "")
