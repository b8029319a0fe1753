"""Where the page is served, and the secret that opens it."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass

from ccr_host.core.addresses import host_and_port, joined, listening_socket

DEFAULT_ADDRESS = "127.0.0.1:8642"
_TOKEN_BYTES = 16


@dataclass(frozen=True)
class ViewAddress:
    """Host and port to listen on; port 0 takes a free one."""

    host: str
    port: int


@dataclass(frozen=True)
class Door:
    """A socket that listens, and what a visitor must know; goes to the process that serves."""

    host: str
    """As the user has written it."""
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

    Args:
        text: to be read.
        option: that it was given with, for messages.

    Raises:
        ConfigError: it is not one.
    """
    return ViewAddress(*host_and_port(text, f"{option} {text}", f"{option} {DEFAULT_ADDRESS}", 0))
