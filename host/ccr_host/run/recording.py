"""The tape: all inputs of the host, in the order in which it received them, and what records them.

The host (control loop, controller, link client) is a deterministic program. It sees the world
only at instants, between which its time does not advance and nothing arrives: one begins at the end
of a wait, and when the clock lets the client process what has arrived. There is a token for each
instant and for each input or output during it. The frames and samples themselves are elsewhere in
the log. Clock, port, tracker and operator of a run are wrapped to record.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from ccr_host.core.clock import Clock, ForeseesArrivals, Parts, Steppable
from ccr_host.core.errors import CcrError, DeviceError
from ccr_host.link.exchange import FrameObserver, Transport
from ccr_host.run.observer import RunObserver
from ccr_host.run.rig import Operator, RunTracker
from ccr_host.tracking.tracker import MarkerFrame, Tracker

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

    ``take`` is called with each piece when it is full or ``_PIECE_US`` long.
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


T = TypeVar("T")


class HostClock:
    """The run's clock as the host sees it; the simulated world uses the clock itself.

    Time advances from instant to instant: at the end of a wait or a computation, and when the clock
    lets the host's parts process what has arrived.
    """

    def __init__(self, clock: Clock, tape: Tape) -> None:
        self._clock = clock
        self._tape = tape
        self._now_us = clock.now_us()
        self._parts = Parts()
        self._is_attached = False
        self.realtime = clock.realtime
        self.instant = 0
        """Number of instants so far."""

    def now_us(self) -> int:
        return self._now_us

    def sleep_until_us(self, time_us: int) -> None:
        self._clock.sleep_until_us(time_us)
        self.wake()

    def idle(self) -> None:
        self._clock.idle()
        self.wake()

    def wake(self) -> None:
        """Begin an instant, after a wait on the clock itself."""
        self._now_us = self._clock.now_us()
        self.instant += 1
        self._tape.at(Token.WOKE, self._now_us)

    def attach(self, part: Steppable) -> None:
        self._parts.attach(part)
        if not self._is_attached:
            self._is_attached = True
            self._clock.attach(self)

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        if not self.realtime:
            return work()

        def noted() -> None:
            self._tape.at(Token.BUSY, self._begin_instant())
            meanwhile()

        try:
            return self._clock.beside(work, every_us, noted)
        finally:
            self.wake()

    def advance_to(self, time_us: int) -> None:
        """Give the host's parts their turn; called by the clock."""
        self._now_us = time_us
        self.instant += 1
        self._tape.begin_turn(time_us)
        try:
            self._parts.advance_to(time_us)
        except BaseException:
            self._tape.note_turn()
            raise
        self._tape.end_turn()

    @property
    def next_turn_us(self) -> int:
        """When a part of the host next needs a turn; earlier turns would have no effect."""
        return self._parts.next_turn_us

    @contextmanager
    def recorded_end(self) -> Iterator[None]:
        """Record an error that ends the run early at its place on the tape."""
        try:
            yield
        except BaseException as error:
            self._tape.end(self._begin_instant(), error)
            raise

    def _begin_instant(self) -> int:
        self._now_us = self._clock.now_us()
        self.instant += 1
        return self._now_us


class RecordedTransport:
    """The connection to the board; returns what has arrived once per instant."""

    def __init__(self, transport: Transport, clock: HostClock, tape: Tape) -> None:
        self.name = transport.name
        self._transport = transport
        self._clock = clock
        self._tape = tape
        self._read_in = -1

    def write(self, data: bytes) -> None:
        try:
            self._transport.write(data)
        except DeviceError as error:
            self._tape.fail(error)
            raise

    def read(self) -> bytes:
        if self._read_in == self._clock.instant:
            return b""
        self._read_in = self._clock.instant
        try:
            return self._transport.read()
        except DeviceError as error:
            self._tape.fail(error)
            raise

    def close(self) -> None:
        self._transport.close()


def recorded_frames(then: FrameObserver, tape: Tape) -> FrameObserver:
    """Record each frame, then pass it on."""

    def note(direction: str, time_us: int, data: bytes) -> None:
        tape.note(Token.FRAME if direction == "received" else Token.SENT)
        then(direction, time_us, data)

    return note


@runtime_checkable
class _ShowsFrames(Protocol):
    @property
    def frame(self) -> MarkerFrame | None: ...


class RecordedTracker(RunTracker):
    """The tracker as the host sees it; attach it to the run's clock after the tracker.

    The observer receives every sample and every frame of markers, used or not.
    """

    def __init__(self, tracker: Tracker, tape: Tape, observer: RunObserver) -> None:
        super().__init__()
        self.name = tracker.name
        self._tracker = tracker
        self._frames = tracker if isinstance(tracker, _ShowsFrames) else None
        self._arrivals = tracker if isinstance(tracker, ForeseesArrivals) else None
        self._tape = tape
        self._observer = observer
        self._frame: MarkerFrame | None = None

    def advance_to(self, time_us: int) -> None:
        """Look for a new frame and a new sample."""
        if self._frames is not None:
            frame = self._frames.frame
            if frame is not None and frame is not self._frame:
                self._frame = frame
                self._observer.marker_frame(time_us, frame)
        sample, before = self._tracker.newest(), self.newest()
        if sample is None or (before is not None and before.exposed_us == sample.exposed_us):
            return
        self._take(sample)
        # First, as the token may complete a piece: the log must have what its tape tells of.
        self._observer.tracker_sample(time_us, sample)
        self._tape.at(Token.SAMPLE, sample.exposed_us)

    @property
    def next_turn_us(self) -> int:
        """Time of the next possible arrival; 0, which is past, if it is there or cannot be told."""
        is_news = self._frames is not None and self._frames.frame is not self._frame
        return 0 if is_news or self._arrivals is None else self._arrivals.next_arrival_us

    def trouble(self) -> str:
        return self._tracker.trouble()


class RecordedOperator:
    """The operator as the control loop sees it."""

    def __init__(self, operator: Operator, tape: Tape) -> None:
        self._operator = operator
        self._tape = tape

    @property
    def wants_stop(self) -> bool:
        return self._noted(self._operator.wants_stop, Token.STOP)

    @property
    def wants_pause(self) -> bool:
        return self._noted(self._operator.wants_pause, Token.PAUSE)

    def news(self) -> str:
        return self._operator.news()

    def _noted(self, wanted: bool, token: Token) -> bool:
        if wanted:
            self._tape.note(token)
        return wanted
