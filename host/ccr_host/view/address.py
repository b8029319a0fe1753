"""Where the page is served."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

from ccr_host.addresses import host_and_port, joined

DEFAULT_ADDRESS = "127.0.0.1:8642"


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
        return f"http://{joined(self.host, port)}/" + (f"?token={token}" if token else "")


def parse_view_address(text: str) -> ViewAddress:
    """Read ``HOST:PORT``; IPv6 in brackets.

    Raises:
        ConfigError: it is not one.
    """
    return ViewAddress(*host_and_port(text, f"--view {text}", f"--view {DEFAULT_ADDRESS}", 0))
