"""Servers of other kinds that may listen where a tracker, board or scheduler is expected."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

import numpy as np

_BAD_REQUEST = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/html\r\nConnection: close\r\n\r\n"
    b"<html><body><h1>400 Bad Request</h1></body></html>\r\n"
)
_WAIT_S = 0.2
_RANDOM_BYTES = 200_000


def _http(peer: socket.socket) -> None:
    """Answers whatever it is asked, and what asks nothing after a while."""
    peer.settimeout(_WAIT_S)
    with contextlib.suppress(TimeoutError):
        peer.recv(4096)
    peer.sendall(_BAD_REQUEST)


def _ssh(peer: socket.socket) -> None:
    peer.sendall(b"SSH-2.0-OpenSSH_9.2p1 Debian-2+deb12u3\r\n")
    _silence(peer)


def _silence(peer: socket.socket) -> None:
    """Accepts, reads, never answers."""
    peer.settimeout(None)
    while peer.recv(4096):
        pass


def _random_bytes(peer: socket.socket) -> None:
    peer.sendall(np.random.default_rng(1).bytes(_RANDOM_BYTES))
    _silence(peer)


def _closes_at_once(_peer: socket.socket) -> None:
    """Sends nothing."""


def _echo(peer: socket.socket) -> None:
    while data := peer.recv(4096):
        peer.sendall(data)


FOREIGN: dict[str, Callable[[socket.socket], None]] = {
    "http": _http,
    "ssh": _ssh,
    "silence": _silence,
    "random bytes": _random_bytes,
    "closes at once": _closes_at_once,
    "echo": _echo,
}


@contextlib.contextmanager
def foreign_server(kind: str) -> Iterator[int]:
    """Serve one of `FOREIGN`, or `hangs`, which never accepts; gives its port on 127.0.0.1."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        peers: list[socket.socket] = []

        def talk(peer: socket.socket) -> None:
            with peer, contextlib.suppress(OSError):
                FOREIGN[kind](peer)

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    peer, _ = listener.accept()
                    peers.append(peer)
                    threading.Thread(target=talk, args=(peer,), daemon=True).start()

        if kind != "hangs":
            threading.Thread(target=serve, daemon=True).start()
        try:
            yield listener.getsockname()[1]
        finally:
            with contextlib.suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)
            for peer in peers:
                with contextlib.suppress(OSError):
                    peer.shutdown(socket.SHUT_RDWR)
