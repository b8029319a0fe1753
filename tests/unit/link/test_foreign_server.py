"""Something else than a board answers at its address."""

import pytest

from ccr_host.core.clock import VirtualClock
from ccr_host.link.client import Client
from ccr_host.link.device_errors import BoardSilentError


class ForeignServer:
    """A transport whose other end is no board."""

    name = "tcp://there:1"

    def __init__(self, greeting: bytes, *, echoes: bool = False) -> None:
        self._to_say = greeting
        self._echoes = echoes

    def write(self, data: bytes) -> None:
        if self._echoes:
            self._to_say += data

    def read(self) -> bytes:
        said, self._to_say = self._to_say, b""
        return said

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    "server",
    [
        ForeignServer(b"SSH-2.0-OpenSSH_9.6\r\n"),
        ForeignServer(bytes(range(1, 255)) * 3),
        ForeignServer(b"", echoes=True),
    ],
    ids=["banner", "noise", "echo"],
)
def test_another_server_in_place_of_the_board_is_named_with_what_it_sent(
    server: ForeignServer,
) -> None:
    client = Client(server, VirtualClock(), session=1)
    with pytest.raises(BoardSilentError) as silent:
        client.connect()
    assert "not a board" in silent.value.cause
    assert "it sent b'" in silent.value.cause
    assert "another server" in silent.value.cure
