"""Clock, port, tracker and operator that tell the host what the tape has recorded."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import NoReturn, TypeVar

from ccr_host.core.clock import Steppable
from ccr_host.core.errors import CcrError, DeviceError, TrackerError
from ccr_host.run.recording import (
    TOKENS_WITH_ERROR,
    TOKENS_WITH_TIME,
    TapeError,
    TapePiece,
    Token,
)
from ccr_host.run.rig import RunTracker
from ccr_host.tracking.tracker import Sample

T = TypeVar("T")

_DOING = {
    Token.TURN: "waited",
    Token.WOKE: "stopped waiting",
    Token.FRAME: "took a frame",
    Token.SENT: "sent a frame",
    Token.SAMPLE: "waited",
    Token.PAUSE: "was told to pause",
    Token.STOP: "was told to stop",
    Token.BUSY: "was still computing",
    Token.PORT_LOST: "lost the port",
    Token.RAISED: "was ended",
}


class TapeEnd(BaseException):
    """The tape is over; passes through whatever the host does about errors."""


class Diverged(BaseException):
    """The host asks for something else than when the tape was recorded; not for it to catch."""


class RecordedError(CcrError):
    """An error of a kind that only the recorded run knew."""


class TapePlayer:
    """Gives out tokens one by one.

    The pieces, in order, are read as they are needed.
    """

    def __init__(self, pieces: Iterable[TapePiece]) -> None:
        self._pieces = iter(pieces)
        self._tokens: deque[Token] = deque()
        self._times_us: deque[int] = deque()
        self._errors: deque[TapeError] = deque()
        self.time_us = 0
        """Time of the clock at the last token."""

    @property
    def head(self) -> Token | None:
        """The next token; None at the end of the tape."""
        while not self._tokens:
            piece = next(self._pieces, None)
            if piece is None:
                return None
            self._tokens.extend(map(Token, piece.tokens))
            self._times_us.extend(piece.times_us)
            self._errors.extend(piece.errors)
        return self._tokens[0]

    def take(self) -> int:
        """Take a token, and the error for which it stands; gives the time that it carries, or 0."""
        token = self._tokens.popleft()
        if token in TOKENS_WITH_ERROR:
            self._errors.popleft()
        if token not in TOKENS_WITH_TIME:
            return 0
        time_us = self._times_us.popleft()
        if token is not Token.SAMPLE:
            self.time_us = time_us
        return time_us

    def take_if(self, token: Token) -> bool:
        """Take the next token if it is this one; whether it was."""
        is_next = self.head is token
        if is_next:
            self.take()
        return is_next

    @property
    def error(self) -> TapeError:
        """Error of the next token that carries one."""
        return self._errors[0]

    def interrupt(self) -> None:
        """Raise what interrupted the recorded run here, between two waits, if anything did."""
        if self.head is Token.RAISED and self.error.kind == KeyboardInterrupt.__name__:
            raise KeyboardInterrupt

    def refuse(self, asked: str) -> NoReturn:
        """The host asks for what is not next on the tape.

        Raises:
            BaseException: what ended the recorded run here, or :class:`TapeEnd`, or
                :class:`Diverged`.
        """
        if self.head is None:
            raise TapeEnd
        if self.head is Token.RAISED:
            raise _raised(self.error)
        raise Diverged(f"the host {asked} where the recorded one {_DOING[self.head]}")


def _raised(error: TapeError) -> BaseException:
    kinds = {kind.__name__: kind for kind in (DeviceError, TrackerError)}
    if error.kind == KeyboardInterrupt.__name__:
        return KeyboardInterrupt()
    return kinds.get(error.kind, RecordedError)(error.cause, error.cure)


class PlayedClock:
    """Gives the recorded times, the client its turns and the tracker its samples; never waits.

    ``realtime`` is that of the recorded run.
    """

    def __init__(self, tape: TapePlayer, tracker: PlayedTracker, *, realtime: bool) -> None:
        self.realtime = realtime
        self._tape = tape
        self._tracker = tracker
        self._parts: list[Steppable] = []

    def now_us(self) -> int:
        return self._tape.time_us

    def sleep_until_us(self, time_us: int) -> None:
        self.idle()

    def idle(self) -> None:
        self._let_the_world_go_on()
        if not self._tape.take_if(Token.WOKE):
            self._tape.refuse("waits")

    def attach(self, part: Steppable) -> None:
        self._parts.append(part)

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        if not self.realtime:
            self._tape.interrupt()
            return work()
        try:
            return work()
        finally:
            self._let_the_world_go_on()
            while self._tape.take_if(Token.BUSY):
                meanwhile()
                self._let_the_world_go_on()
            self.idle()

    def _let_the_world_go_on(self) -> None:
        while (token := self._tape.head) in (Token.TURN, Token.SAMPLE):
            time_us = self._tape.take()
            if token is Token.SAMPLE:
                self._tracker.arrive(time_us)
                continue
            for part in self._parts:
                part.advance_to(time_us)


class PlayedTransport:
    """Delivers the recorded frames."""

    name = "replay"

    def __init__(self, tape: TapePlayer, received: Iterator[bytes]) -> None:
        self._tape = tape
        self._received = received

    def write(self, data: bytes) -> None:
        self._fail_if_recorded()

    def read(self) -> bytes:
        self._tape.interrupt()
        self._fail_if_recorded()
        data = b""
        while self._tape.take_if(Token.FRAME):
            frame = next(self._received, None)
            if frame is None:
                raise TapeEnd
            data += frame
        return data

    def close(self) -> None:
        """Nothing to close."""

    def _fail_if_recorded(self) -> None:
        if self._tape.head is Token.PORT_LOST:
            error = self._tape.error
            self._tape.take()
            raise DeviceError(error.cause, error.cure)


class PlayedTracker(RunTracker):
    """Delivers the recorded samples.

    They are given by the times of their exposures.
    """

    name = "replay"

    def __init__(self, samples: dict[int, Sample]) -> None:
        super().__init__()
        self._samples = samples

    def arrive(self, exposed_us: int) -> None:
        """Let a sample arrive."""
        while self._samples:
            first_us = next(iter(self._samples))
            sample = self._samples.pop(first_us)
            if first_us == exposed_us:
                self._take(sample)
                return
        raise Diverged("the tape tells of a sample that is not in the log")

    def trouble(self) -> str:
        """The recorded error has told it."""
        return ""


class PlayedOperator:
    """Wants what the recorded one wanted."""

    def __init__(self, tape: TapePlayer) -> None:
        self._tape = tape

    @property
    def wants_stop(self) -> bool:
        return self._tape.take_if(Token.STOP)

    @property
    def wants_pause(self) -> bool:
        return self._tape.take_if(Token.PAUSE)

    def news(self) -> str:
        return ""


@contextmanager
def played_end(tape: TapePlayer) -> Iterator[None]:
    """What ended the recorded run early ends the replayed one in the same place.

    Raises:
        Diverged: only one of the two was ended here.
    """
    try:
        yield
    except (TapeEnd, Diverged):
        raise
    except BaseException as error:
        if tape.head is None:
            raise TapeEnd from None
        if tape.head is not Token.RAISED:
            raise Diverged(f"the host ends with: {error}") from error
        tape.take()
        raise
