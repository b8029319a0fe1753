"""The gate before a server that answers in capitals."""

import socket
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from ccr_host.errors import ConfigError
from ccr_host.view.address import ViewAddress
from ccr_host.view.admission import Admission
from ccr_host.view.gate import Gate

HEAD = "GET /{} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@pytest.fixture
def shouting_server() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    while data := connection.recv(4096):
                        connection.sendall(data.upper())

        threading.Thread(target=serve, daemon=True).start()
        yield listener.getsockname()[1]


def gate_port(server_port: int, token: str | None = None) -> int:
    return Gate(ViewAddress("127.0.0.1", 0), Admission(token), server_port).open()


def talk(port: int, *sent: str) -> str:
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        received = b""
        for piece in sent:
            connection.sendall(piece.encode())
        connection.shutdown(socket.SHUT_WR)
        with suppress(ConnectionResetError):  # hung up on before all was said
            while data := connection.recv(4096):
                received += data
    return received.decode()


def test_bytes_pass_unchanged_once_admitted(shouting_server: int) -> None:
    port = gate_port(shouting_server)
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        stream = connection.makefile("rwb")
        stream.write(HEAD.format("page").encode())
        stream.flush()
        assert [stream.readline() for _ in range(3)] == [
            b"GET /PAGE HTTP/1.1\r\n",
            b"HOST: 127.0.0.1\r\n",
            b"\r\n",
        ]
        for word in (b"one\n", b"two\n"):
            stream.write(word)
            stream.flush()
            assert stream.readline() == word.upper()


def test_without_the_token_nothing_reaches_the_server(shouting_server: int) -> None:
    port = gate_port(shouting_server, token="s3cret")
    assert talk(port, HEAD.format("")).startswith("HTTP/1.1 403 ")
    assert talk(port, HEAD.format("?token=s3cret")).startswith("HTTP/1.1 303 ")


def test_a_head_that_does_not_end_is_refused(shouting_server: int) -> None:
    port = gate_port(shouting_server)
    assert "xxx" not in talk(port, "GET / HTTP/1.1\r\n", "x" * 20_000).lower()
    assert "OK" in talk(port, HEAD.format("ok")), "and the next visitor is served"


def test_a_visitor_who_says_nothing_is_let_go(shouting_server: int) -> None:
    assert talk(gate_port(shouting_server)) == ""


def test_a_port_that_is_taken_is_named(shouting_server: int) -> None:
    with pytest.raises(ConfigError, match=str(shouting_server)):
        Gate(ViewAddress("127.0.0.1", shouting_server), Admission(None), 1).open()
