"""Sequential scripts of a protocol, and their execution without waiting.

A script is a generator. It acts on the port and yields what it waits for; it is resumed with the
reply or exception as soon as that is known. So a sequence can be read in one place, while the run
continues in between.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from ccr_host.core.errors import TrackerError
from ccr_host.tracking.sources.ndi.port import Port
from ccr_host.tracking.sources.ndi.replies import (
    CommandRefusedError,
    DamagedReplyError,
    ReplySplitter,
    decode_reply,
)
from ccr_host.tracking.tracker import ForeignPeerError

_SHOWN_BYTES = 24


class Wait(NamedTuple):
    """What a script waits for: some time, or the next reply, at most for that time.

    In place of a reply, silence, damage and refusals raise exceptions.
    """

    duration_us: int
    for_reply: bool = False


@dataclass(frozen=True)
class Reply:
    """A correct reply."""

    text: str
    arrived_us: int
    length: int
    """Bytes on the wire, with CRC and carriage return."""


Script: TypeAlias = Generator[Wait, Reply | None, None]


class NoReplyError(TrackerError):
    """No reply, or an incomplete one."""

    def __init__(self, unfinished: bytes = b"") -> None:
        self.unfinished = unfinished
        super().__init__("the camera does not answer", "check power, cable and port or address")


class NotACameraError(ForeignPeerError):
    """The replies are not those of a camera."""

    def __init__(self, heard: bytes) -> None:
        shown = bytes(heard[:_SHOWN_BYTES])
        super().__init__(
            f"what answers there is no NDI camera (it sent {shown!r})",
            "check port or address; power the camera off and on",
        )


class Conversation:
    """Executes a script, made for this conversation, on a port that is open."""

    def __init__(self, port: Port, make_script: Callable[[Conversation], Script]) -> None:
        self.port = port
        self._script = make_script(self)
        self._splitter = ReplySplitter()
        self._replies: deque[bytes] = deque()
        self._awaited = Wait(0)
        self.next_turn_us = 0
        """Time of the next turn if nothing arrives."""

    def say(self, data: bytes) -> None:
        """Send bytes; unread replies, which answer something else, are discarded."""
        self._splitter.clear()
        self._replies.clear()
        self.port.write(data)

    def advance_to(self, time_us: int) -> None:
        """Advance the script as far as possible.

        Raises:
            TrackerError: an error that the script does not handle, or the port is lost.
        """
        self._replies.extend(self._splitter.feed(self.port.read()))
        while True:
            heard: Reply | TrackerError | None = None
            if self._awaited.for_reply and self._replies:
                heard = _understand(self._replies.popleft(), time_us)
            elif time_us < self.next_turn_us:
                return
            elif self._awaited.for_reply:
                heard = NoReplyError(self._splitter.unfinished)
            if isinstance(heard, TrackerError):
                self._awaited = self._script.throw(heard)
            else:
                self._awaited = self._script.send(heard)
            self.next_turn_us = time_us + self._awaited.duration_us


def _understand(line: bytes, time_us: int) -> Reply | TrackerError:
    try:
        return Reply(decode_reply(line), time_us, len(line) + 1)
    except (DamagedReplyError, CommandRefusedError) as error:
        return error
