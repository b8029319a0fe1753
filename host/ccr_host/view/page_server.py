"""The page's server, behind the gate."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

from viser import ViserServer

from ccr_host.view.address import ViewAddress
from ccr_host.view.admission import Admission
from ccr_host.view.gate import Gate

_TOKEN_BYTES = 16


class _UnsharedServer(ViserServer):
    """Without the button that publishes the page through somebody else's server."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        return None


@contextmanager
def page_server(address: ViewAddress) -> Iterator[tuple[ViserServer, str]]:
    """Serve an empty page; yields the server and the address to open.

    Raises:
        ConfigError: the address cannot be had.
    """
    token = None if address.is_local else secrets.token_urlsafe(_TOKEN_BYTES)
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):  # it greets there
        server = _UnsharedServer(host="127.0.0.1", port=0, verbose=False)
        try:
            port = Gate(address, Admission(token), server.get_port()).open()
            yield server, address.url(port, token)
        finally:
            server.stop()
