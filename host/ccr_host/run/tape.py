"""The tape: what the host was told from outside, in the order in which it was told.

The host (control loop, controller, link client) is a deterministic program whose only inputs are
readings of the clock, turns that the clock gives to the client, frames from the board, samples of
the tracker, and errors of port, tracker and user. One token stands for each of them. Frames and
samples themselves are elsewhere in the log; a token says when one of them was taken.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

from ccr_host.core.errors import CcrError

_PIECE_US = 100_000
"""So much less than a second that a log cut short ends with the tape, too."""
_PIECE_TOKENS = 4096


class Token(enum.StrEnum):
    """One letter each; those marked with a time carry one, in us on the run's clock."""

    READ = "r"
    """The clock was read; the time it gave."""
    TURN = "t"
    """The clock let the client take in what had arrived, and something had; the time it told."""
    WOKE = "w"
    """A wait was over."""
    FRAME = "f"
    """The next frame from the board was taken."""
    SAMPLE = "s"
    """The tracker's newest sample was another one than before; its exposure time."""
    SAME = "="
    """The tracker's newest sample was still the same, or still none."""
    PAUSE = "h"
    """The operator was asked and wanted a pause."""
    STOP = "k"
    """The operator was asked and wanted a stop."""
    BUSY = "b"
    """The controller was still computing, and the board was fed meanwhile."""
    PORT_LOST = "p"
    """The port failed; an error."""
    RAISED = "x"
    """Something from outside ended the run: an interruption, a tracker; an error."""


TOKENS_WITH_TIME = frozenset({Token.READ, Token.TURN, Token.SAMPLE})
TOKENS_WITH_ERROR = frozenset({Token.PORT_LOST, Token.RAISED})


@dataclass(frozen=True)
class TapeError:
    """What a token that stands for an error tells of it."""

    kind: str
    cause: str
    cure: str

    @staticmethod
    def of(error: BaseException) -> TapeError:
        """Of what was raised."""
        if isinstance(error, CcrError):
            return TapeError(type(error).__name__, error.cause, error.cure)
        return TapeError(type(error).__name__, str(error), "")


@dataclass(frozen=True)
class TapePiece:
    """A stretch of the tape that can be read by itself."""

    start_us: int
    """The last time on the tape before it."""
    tokens: str
    times_us: list[int]
    """One for each token that carries a time."""
    errors: list[TapeError]
    """One for each token that stands for an error."""

    def checked(self) -> TapePiece:
        """The piece itself.

        Raises:
            ValueError: a letter that is no token, or not as many times or errors as tokens need.
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
        take: gets each piece once it is full or ``_PIECE_US`` long.
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
        self.note_turn()
        self._append_timed(token, time_us)

    def note(self, token: Token) -> None:
        """Note a token that carries nothing."""
        self.note_turn()
        self._tokens.append(token)

    def fail(self, token: Token, error: BaseException) -> None:
        """Note a token that stands for an error."""
        self.note(token)
        self._errors.append(TapeError.of(error))

    def begin_turn(self, time_us: int) -> None:
        """A turn begins, which is noted before whatever happens in it.

        Turns in which nothing happens, a thousand a second, change nothing in the host.
        """
        self._turn_us = time_us

    def note_turn(self) -> None:
        """Something has happened in this turn, if there is one."""
        if self._turn_us is not None:
            time_us, self._turn_us = self._turn_us, None
            self._append_timed(Token.TURN, time_us)

    def end_turn(self) -> None:
        """The turn is over."""
        self._turn_us = None

    def pass_on(self) -> None:
        """Pass on what has been collected."""
        if not self._tokens:
            return
        piece = TapePiece(self._start_us, "".join(self._tokens), self._times_us, self._errors)
        self._start_us = self._newest_us
        self._tokens, self._times_us, self._errors = [], [], []
        self._take(piece)

    def _append_timed(self, token: Token, time_us: int) -> None:
        self._newest_us = time_us
        self._tokens.append(token)
        self._times_us.append(time_us)
        if time_us - self._start_us >= _PIECE_US or len(self._tokens) >= _PIECE_TOKENS:
            self.pass_on()
