"""Where the page is served."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

from ccr_host.errors import ConfigError

DEFAULT_ADDRESS = "127.0.0.1:8642"
_HIGHEST_PORT = 65_535


@dataclass(frozen=True)
class ViewAddress:
    """Host and port to listen on; port 0 takes a free one."""

    host: str
    port: int

    @property
    def is_local(self) -> bool:
        """Whether only this machine reaches it."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def url(self, port: int, token: str | None) -> str:
        """What to open in a browser.

        Args:
            port: that was really bound.
            token: None where none is asked for.
        """
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/" + (f"?token={token}" if token else "")


def parse_view_address(text: str) -> ViewAddress:
    """Read ``HOST:PORT``; IPv6 in brackets.

    Raises:
        ConfigError: it is not one.
    """
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) <= _HIGHEST_PORT):
        raise ConfigError(f"--view {text}: not HOST:PORT", f"for example --view {DEFAULT_ADDRESS}")
    return ViewAddress(host.removeprefix("[").removesuffix("]"), int(port))
