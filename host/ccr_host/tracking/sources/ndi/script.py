"""Sequential scripts of a protocol, and their execution without waiting.

A script is a generator. It yields the next step, and is resumed with its result or exception as
soon as that is known. So a sequence can be read in one place, while the run continues in between.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeAlias

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


@dataclass(frozen=True)
class Say:
    """Send bytes without waiting; unread replies, which answer something else, are discarded."""

    data: bytes


@dataclass(frozen=True)
class Hear:
    """Wait for the next reply; silence, damage and refusals raise exceptions."""

    timeout_us: int


@dataclass(frozen=True)
class Pause:
    """Wait for some time."""

    duration_us: int


@dataclass(frozen=True)
class SetBaud:
    """Change the host's rate; raises an exception if the port does not support it."""

    baud: int


@dataclass(frozen=True)
class SetBreak:
    """Begin or end a break of the line."""

    on: bool


@dataclass(frozen=True)
class Reply:
    """A correct reply."""

    text: str
    arrived_us: int
    length: int
    """Bytes on the wire, with CRC and carriage return."""


Step: TypeAlias = Say | Hear | Pause | SetBaud | SetBreak
Script: TypeAlias = Generator[Step, Reply | None, None]


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
    """Executes a script on a port.

    The port is open, and the script has not started.
    """

    def __init__(self, port: Port, script: Script) -> None:
        self._port = port
        self._script = script
        self._splitter = ReplySplitter()
        self._replies: deque[bytes] = deque()
        self._step: Step | None = None
        self._deadline_us = 0
        self._failure: TrackerError | None = None
        """Error of a step that ends immediately."""

    def advance_to(self, time_us: int) -> None:
        """Advance the script as far as possible.

        Raises:
            TrackerError: an error that the script does not handle, or the port is lost.
        """
        self._replies.extend(self._splitter.feed(self._port.read()))
        if self._step is None:
            self._take(next(self._script), time_us)
        while True:
            result = self._result(time_us)
            if result is _PENDING:
                return
            self._take(self._resume(result), time_us)

    @property
    def next_turn_us(self) -> int:
        """Time of the next turn if nothing arrives."""
        return self._deadline_us if isinstance(self._step, Hear | Pause) else 0

    def _take(self, step: Step, time_us: int) -> None:
        """Begin a step."""
        self._step = step
        match step:
            case Say(data):
                self._splitter.clear()
                self._replies.clear()
                self._port.write(data)
            case Hear(duration_us) | Pause(duration_us):
                self._deadline_us = time_us + duration_us
            case SetBaud(baud):
                try:
                    self._port.set_baud(baud)
                except TrackerError as error:
                    self._failure = error
            case SetBreak(on):
                self._port.set_break(on)

    def _result(self, time_us: int) -> object:
        """Result of the current step: a `Reply`, an error, None, or `_PENDING`."""
        match self._step:
            case Hear():
                if self._replies:
                    return _understand(self._replies.popleft(), time_us)
                is_over = time_us >= self._deadline_us
                return NoReplyError(self._splitter.unfinished) if is_over else _PENDING
            case Pause():
                return None if time_us >= self._deadline_us else _PENDING
        failure, self._failure = self._failure, None
        return failure

    def _resume(self, result: object) -> Step:
        if isinstance(result, TrackerError):
            return self._script.throw(result)
        return self._script.send(result if isinstance(result, Reply) else None)


_PENDING = object()


def _understand(line: bytes, time_us: int) -> Reply | TrackerError:
    try:
        return Reply(decode_reply(line), time_us, len(line) + 1)
    except (DamagedReplyError, CommandRefusedError) as error:
        return error
