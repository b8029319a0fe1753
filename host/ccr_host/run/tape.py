"""The tape: all inputs of the host, in the order in which it received them.

The host (control loop, controller, link client) is a deterministic program. It sees the world
only at instants, between which its time does not advance and nothing arrives: one begins at the end
of a wait, and when the clock lets the client process what has arrived. There is a token for each
instant and for each input or output during it. The frames and samples themselves are elsewhere in
the log.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ccr_host.core.errors import CcrError, DeviceError

_PIECE_US = 100_000
"""Much less than a second, so that the tape of a truncated log ends with it."""
_PIECE_TOKENS = 4096


class Token(enum.StrEnum):
    """One letter each; those marked with a time carry one, in us on the run's clock."""

    TURN = "t"
    """The clock let the client process what had arrived, if anything had; its time."""
    WOKE = "w"
    """A wait or a computation ended; the time."""
    FRAME = "f"
    """The next frame from the board was received."""
    SENT = "o"
    """The next frame to the board was sent."""
    SAMPLE = "s"
    """A new sample of the tracker arrived; its exposure time."""
    PAUSE = "h"
    """The operator was asked and wanted a pause."""
    STOP = "k"
    """The operator was asked and wanted a stop."""
    BUSY = "b"
    """The controller was still computing, and the board was fed meanwhile; the time."""
    PORT_LOST = "p"
    """The port failed; an error."""
    RAISED = "x"
    """Something ended the run: an interruption, a tracker; the time, and an error."""


TOKENS_WITH_TIME = frozenset({Token.TURN, Token.WOKE, Token.SAMPLE, Token.BUSY, Token.RAISED})
TOKENS_WITH_ERROR = frozenset({Token.PORT_LOST, Token.RAISED})


@dataclass(frozen=True)
class TapeError:
    """The error that a token stands for."""

    kind: str
    cause: str
    cure: str

    @staticmethod
    def of(error: BaseException) -> TapeError:
        """Convert an exception."""
        if isinstance(error, CcrError):
            return TapeError(type(error).__name__, error.cause, error.cure)
        return TapeError(type(error).__name__, str(error), "")


@dataclass(frozen=True)
class TapePiece:
    """A section of the tape that can be read on its own."""

    start_us: int
    """The last time on the tape before it."""
    tokens: str
    times_us: list[int]
    """One time for each token that carries one."""
    errors: list[TapeError]
    """One error for each token that stands for one."""

    def checked(self) -> TapePiece:
        """Validate the piece and return it.

        Raises:
            ValueError: a letter is not a token, or the number of times or errors does not match.
        """
        tokens = [Token(letter) for letter in self.tokens]
        times = sum(token in TOKENS_WITH_TIME for token in tokens)
        errors = sum(token in TOKENS_WITH_ERROR for token in tokens)
        if (times, errors) != (len(self.times_us), len(self.errors)):
            raise ValueError(f"{len(tokens)} tokens with {len(self.times_us)} times")
        return self


TapeReader = Callable[[TapePiece], None]


class Tape:
    """Collects tokens and passes them on in pieces.

    Args:
        take: called with each piece when it is full or ``_PIECE_US`` long.
    """

    def __init__(self, take: TapeReader) -> None:
        self._take = take
        self._tokens: list[str] = []
        self._times_us: list[int] = []
        self._errors: list[TapeError] = []
        self._start_us = self._newest_us = 0
        self._turn_us: int | None = None

    def at(self, token: Token, time_us: int) -> None:
        """Note a token that carries a time."""
        if self._turn_us is not None:
            self.note_turn()
        self._newest_us = time_us
        self._tokens.append(token)
        self._times_us.append(time_us)
        if time_us - self._start_us >= _PIECE_US or len(self._tokens) >= _PIECE_TOKENS:
            self.pass_on()

    def note(self, token: Token) -> None:
        """Note a token without a time."""
        if self._turn_us is not None:
            self.note_turn()
        self._tokens.append(token)

    def fail(self, error: DeviceError) -> None:
        """Note that the port has failed."""
        self.note(Token.PORT_LOST)
        self._errors.append(TapeError.of(error))

    def end(self, time_us: int, error: BaseException) -> None:
        """Note the error that has ended the run."""
        self.note_turn()
        self._errors.append(TapeError.of(error))
        self.at(Token.RAISED, time_us)

    def begin_turn(self, time_us: int) -> None:
        """Begin a turn; it is noted only if something happens in it.

        Turns in which nothing happens, a thousand per second, change nothing in the host.
        """
        self._turn_us = time_us

    def note_turn(self) -> None:
        """Note the present turn, if there is one, as something has happened in it."""
        if self._turn_us is not None:
            time_us, self._turn_us = self._turn_us, None
            self.at(Token.TURN, time_us)

    def end_turn(self) -> None:
        """End the turn."""
        self._turn_us = None

    @contextmanager
    def passed_on(self) -> Iterator[None]:
        """Pass on the last piece at the end."""
        try:
            yield
        finally:
            self.pass_on()

    def pass_on(self) -> None:
        """Pass on what has been collected."""
        if not self._tokens:
            return
        piece = TapePiece(self._start_us, "".join(self._tokens), self._times_us, self._errors)
        self._start_us = self._newest_us
        self._tokens, self._times_us, self._errors = [], [], []
        self._take(piece)
