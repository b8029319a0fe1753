"""Clock, port and tracker of a run as the host sees them, with a tape running along."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar, runtime_checkable

from ccr_host.core.clock import Clock, Parts, Steppable
from ccr_host.core.errors import DeviceError
from ccr_host.link.exchange import FrameObserver
from ccr_host.link.transport import Transport
from ccr_host.run.observer import RunObserver
from ccr_host.run.operator import Operator
from ccr_host.run.tape import Tape, Token
from ccr_host.tracking.tracker import MarkerFrame, Sample, Tracker

T = TypeVar("T")


class RecordedClock:
    """The run's clock in the hands of the host; the rest of the world uses the clock itself."""

    def __init__(self, clock: Clock, tape: Tape) -> None:
        self._clock = clock
        self._tape = tape
        self._parts = Parts()
        self._is_attached = False
        self.realtime = clock.realtime

    def now_us(self) -> int:
        time_us = self._clock.now_us()
        self._tape.at(Token.READ, time_us)
        return time_us

    def sleep_until_us(self, time_us: int) -> None:
        self._clock.sleep_until_us(time_us)
        self._tape.note(Token.WOKE)

    def idle(self) -> None:
        self._clock.idle()
        self._tape.note(Token.WOKE)

    def attach(self, part: Steppable) -> None:
        self._parts.attach(part)
        if not self._is_attached:
            self._is_attached = True
            self._clock.attach(self)

    def beside(self, work: Callable[[], T], every_us: int, meanwhile: Callable[[], None]) -> T:
        def noted() -> None:
            self._tape.note(Token.BUSY)
            meanwhile()

        return self._clock.beside(work, every_us, noted)

    def advance_to(self, time_us: int) -> None:
        """Give the host's parts their turn, on behalf of the clock."""
        self._tape.begin_turn(time_us)
        try:
            self._parts.advance_to(time_us)
        except BaseException:
            self._tape.note_turn()
            raise
        self._tape.end_turn()

    @property
    def next_turn_us(self) -> int:
        """When one of the host's parts needs a turn; those before it would leave nothing."""
        return self._parts.next_turn_us


class RecordedTransport:
    """The way to the board."""

    def __init__(self, transport: Transport, tape: Tape) -> None:
        self.name = transport.name
        self._transport = transport
        self._tape = tape

    def write(self, data: bytes) -> None:
        try:
            self._transport.write(data)
        except DeviceError as error:
            self._tape.fail(Token.PORT_LOST, error)
            raise

    def read(self) -> bytes:
        try:
            return self._transport.read()
        except DeviceError as error:
            self._tape.fail(Token.PORT_LOST, error)
            raise

    def close(self) -> None:
        self._transport.close()


@runtime_checkable
class _ShowsFrames(Protocol):
    @property
    def frame(self) -> MarkerFrame | None: ...


@runtime_checkable
class _ForeseesArrivals(Protocol):
    @property
    def next_arrival_us(self) -> int: ...


class RecordedTracker:
    """The tracker in the hands of the control loop; attach it to the clock behind the tracker.

    The observer is shown every sample and every frame of markers, used or not.
    """

    def __init__(self, tracker: Tracker, clock: Clock, tape: Tape, observer: RunObserver) -> None:
        self.name = tracker.name
        self._tracker = tracker
        self._frames = tracker if isinstance(tracker, _ShowsFrames) else None
        self._arrivals = tracker if isinstance(tracker, _ForeseesArrivals) else None
        self._clock = clock
        self._tape = tape
        self._observer = observer
        self._shown_frame: MarkerFrame | None = None
        self._shown_us: int | None = None
        self._taken_us: int | None = None

    def advance_to(self, time_us: int) -> None:
        """Look for what is new."""
        self._look(time_us)

    @property
    def next_turn_us(self) -> int:
        """When there may be something new; 0, which has passed, where the tracker cannot tell."""
        return 0 if self._arrivals is None else self._arrivals.next_arrival_us

    def newest(self) -> Sample | None:
        sample = self._look(self._clock.now_us())
        if sample is None or sample.exposed_us == self._taken_us:
            self._tape.note(Token.SAME)
        else:
            self._taken_us = sample.exposed_us
            self._tape.at(Token.SAMPLE, sample.exposed_us)
        return sample

    def trouble(self) -> str:
        return self._tracker.trouble()

    def _look(self, time_us: int) -> Sample | None:
        if self._frames is not None:
            frame = self._frames.frame
            if frame is not None and frame is not self._shown_frame:
                self._shown_frame = frame
                self._observer.marker_frame(time_us, frame)
        sample = self._tracker.newest()
        if sample is not None and sample.exposed_us != self._shown_us:
            self._shown_us = sample.exposed_us
            self._observer.tracker_sample(time_us, sample)
        return sample


class RecordedOperator:
    """The operator in the hands of the control loop."""

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


def recorded_frames(then: FrameObserver, tape: Tape) -> FrameObserver:
    """Note each frame that comes in, and pass all on."""

    def note(direction: str, time_us: int, data: bytes) -> None:
        if direction == "received":
            tape.note(Token.FRAME)
        then(direction, time_us, data)

    return note


@contextmanager
def recorded_end(tape: Tape) -> Iterator[None]:
    """Note what ends the run early, in its place on the tape."""
    try:
        yield
    except BaseException as error:
        tape.fail(Token.RAISED, error)
        raise


@contextmanager
def passed_on(tape: Tape) -> Iterator[None]:
    """Pass on the last piece of the tape at the end."""
    try:
        yield
    finally:
        tape.pass_on()
