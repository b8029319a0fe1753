"""Access to the workers of a sweep on this machine."""

import asyncio

import pytest
from distributed import Security
from distributed.core import rpc

from ccr_host.tools.sweep.workers import local_workers
from tests.patience import PATIENCE_S


async def ask(address: str, security: Security, patience_s: float = 3) -> None:
    arguments = security.get_connection_args("client")
    async with rpc(address, timeout=patience_s, connection_args=arguments) as peer:
        await asyncio.wait_for(peer.identity(), patience_s)


@pytest.mark.long
def test_clients_without_certificates_cannot_reach_the_scheduler_of_a_sweep() -> None:
    with local_workers(1) as client:
        address = client.scheduler.address
        assert client.submit(sum, [1, 2]).result() == 3
        asyncio.run(ask(address, client.security, PATIENCE_S))
        for stranger in (Security(), Security.temporary()):
            with pytest.raises((OSError, TypeError, RuntimeError)):
                asyncio.run(ask(address, stranger))
        with pytest.raises(OSError):
            asyncio.run(ask(address.replace("tls://", "tcp://"), Security()))
