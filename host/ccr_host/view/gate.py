"""The page's front door: admits a connection, then passes its bytes on to the page's server."""

from __future__ import annotations

import asyncio
import threading
from contextlib import suppress
from http import HTTPStatus

from ccr_host.errors import ConfigError
from ccr_host.view.address import ViewAddress
from ccr_host.view.admission import Admission, BadRequestError, RequestHead, Verdict, refusal

_HEAD_LIMIT_BYTES = 16_384
_HEAD_TIMEOUT_S = 10.0
_CHUNK_BYTES = 65_536


class Gate:
    """Listens in a thread of its own.

    Args:
        address: to listen on.
        admission: the rule.
        server_port: of the page's server, on 127.0.0.1.
    """

    def __init__(self, address: ViewAddress, admission: Admission, server_port: int) -> None:
        self._address = address
        self._admission = admission
        self._server_port = server_port
        self._loop = asyncio.new_event_loop()

    def open(self) -> int:
        """Start listening; gives the port that was bound.

        Raises:
            ConfigError: the address cannot be had.
        """
        try:
            server = self._loop.run_until_complete(self._listen())
        except OSError as error:
            raise ConfigError(
                f"--view {self._address.host}:{self._address.port}: {error.strerror or error}",
                "name another address or port; port 0 takes a free one",
            ) from None
        threading.Thread(target=self._loop.run_forever, daemon=True, name="gate").start()
        port: int = server.sockets[0].getsockname()[1]
        return port

    async def _listen(self) -> asyncio.Server:
        return await asyncio.start_server(
            self._meet, self._address.host, self._address.port, limit=_HEAD_LIMIT_BYTES
        )

    async def _meet(self, visitor: asyncio.StreamReader, answer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            head = await self._admitted_head(visitor, answer)
            if head is not None:
                await self._connect_through(head, visitor, answer)
        answer.close()

    async def _admitted_head(
        self, visitor: asyncio.StreamReader, answer: asyncio.StreamWriter
    ) -> bytes | None:
        try:
            head = await asyncio.wait_for(visitor.readuntil(b"\r\n\r\n"), _HEAD_TIMEOUT_S)
            verdict = self._admission.judge(RequestHead.parse(head))
        except (BadRequestError, asyncio.LimitOverrunError):
            answer.write(refusal(HTTPStatus.BAD_REQUEST))
            return None
        except (asyncio.IncompleteReadError, TimeoutError):
            return None
        if verdict is Verdict.ADMITTED:
            return head
        if verdict is Verdict.WELCOMED:
            answer.write(self._admission.welcome())
        else:
            answer.write(refusal(HTTPStatus.FORBIDDEN))
        await answer.drain()
        return None

    async def _connect_through(
        self, head: bytes, visitor: asyncio.StreamReader, answer: asyncio.StreamWriter
    ) -> None:
        page, to_page = await asyncio.open_connection("127.0.0.1", self._server_port)
        to_page.write(head)
        inwards = asyncio.create_task(_pass_on(visitor, to_page))
        await _pass_on(page, answer)
        inwards.cancel()
        to_page.close()


async def _pass_on(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        try:
            while data := await source.read(_CHUNK_BYTES):
                sink.write(data)
                await sink.drain()
        finally:
            sink.write_eof()
