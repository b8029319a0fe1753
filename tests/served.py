"""What tests wait for on the boards that they serve in a thread."""

from __future__ import annotations

from ccr_host.sim.serving.server import BoardServer
from tests.patience import becomes_true


def wait_until_left(server: BoardServer) -> None:
    """Wait until the board has noticed that its client is gone.

    A pseudo-terminal that is opened again before was never closed as far as its board can tell.
    """
    port = server._stations[0].port
    assert becomes_true(lambda: not port._client)
