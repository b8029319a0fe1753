"""Executes the host again on the recorded inputs of a run and compares what it sends."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, NoReturn, TypeVar

import numpy as np

from ccr_host.control.base import Controller
from ccr_host.control.registry import make_controller
from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.link.client import Client
from ccr_host.link.framing import decode_single_frame
from ccr_host.link.messages import OpenSession, PayloadError
from ccr_host.link.transport import parse_device_uri
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogMessage, RunRecording
from ccr_host.record.log.tables import told_frame
from ccr_host.record.playing import (
    Diverged,
    PlayedClock,
    PlayedOperator,
    PlayedTracker,
    PlayedTransport,
    TapeEnd,
    TapePlayer,
    played_end,
)
from ccr_host.run.loop import PathRun
from ccr_host.run.observer import Observers, StepRecord
from ccr_host.run.open_rig import is_simulated, meet_board
from ccr_host.run.recording import Tape, TapeError, TapePiece, Token
from ccr_host.run.rig import Rig, stopping_at_once
from ccr_host.run.robot_check import motion_check
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

T = TypeVar("T")


@dataclass(frozen=True)
class Difference:
    """The first point at which the replayed host differs from the recorded one."""

    time_us: int
    steps_done: int
    what: str


@dataclass
class ReplayResult:
    """How far the replay has come, and how it ended."""

    frames: int = 0
    """Number of frames sent that were equal."""
    steps: int = 0
    end_us: int = 0
    difference: Difference | None = None


def replay(recording: RunRecording, controller: str | None = None) -> ReplayResult:
    """Run controller, control loop and client again; stops at the first difference.

    ``controller`` takes the place of the recorded one, whose file may have been moved.

    Raises:
        ConfigError: the log lacks messages, or cannot be read, or its controller is not there.
        CodeError: a controller of the user's cannot be made.
    """
    if recording.end.lost_messages:
        raise ConfigError(
            f"recording {recording.source}: "
            + (recording.end.trouble or f"{recording.end.lost_messages} messages were lost"),
            "a log with gaps cannot be replayed; report and export use what is left",
        )
    name = controller or recording.options.controller
    return _Replay(recording, make_controller(name, recording.description)).run()


@dataclass
class _Feed:
    """Reads the log once and sorts it; each taker reads on as far as it needs."""

    recording: RunRecording
    pieces: deque[TapePiece] = field(default_factory=deque)
    sent: deque[LogMessage] = field(default_factory=deque)
    received: deque[bytes] = field(default_factory=deque)
    samples: dict[int, Sample] = field(default_factory=dict)
    failure: ConfigError | None = None
    """Why reading stopped, if it failed."""

    def __post_init__(self) -> None:
        self._messages = self.recording.messages(*_INPUT_TOPICS)

    def taken(self, kind: deque[T]) -> Iterator[T]:
        """Take what there is of one kind, one after the other."""
        while kind or self._read_until(kind):
            yield kind.popleft()

    def _read_until(self, filled: deque[Any]) -> bool:
        try:
            for message in self._messages:
                self._sort(message)
                if filled:
                    return True
        except ConfigError as error:
            self.failure = error
            raise TapeEnd from None  # which nothing that is replayed takes for its own error
        return False

    def _sort(self, message: LogMessage) -> None:
        content = message.content
        try:
            match message.topic:
                case topics.INPUTS.name:
                    self.pieces.append(_piece(content))
                case topics.SENT.name:
                    bytes.fromhex(content["hex"])
                    self.sent.append(message)
                case topics.RECEIVED.name:
                    self.received.append(bytes.fromhex(content["hex"]))
                case topics.SAMPLE.name:
                    markers_mm = np.array(content["markers_mm"], dtype=np.float64)
                    self.samples[content["exposed_us"]] = Sample(content["exposed_us"], markers_mm)
        except (KeyError, ValueError, TypeError):
            raise self.recording.foreign(f"messages on {message.topic}") from None


_INPUT_TOPICS = (topics.INPUTS, topics.SENT, topics.RECEIVED, topics.SAMPLE)


class _Replay:
    def __init__(self, recording: RunRecording, controller: Controller) -> None:
        self._recording = recording
        self._controller = controller
        self._feed = _Feed(recording)
        self._sent = self._feed.taken(self._feed.sent)
        self._tape = TapePlayer(self._feed.taken(self._feed.pieces))
        self._result = ReplayResult()

    def run(self) -> ReplayResult:
        try:
            self._execute()
            self._require_end()
        except TapeEnd:
            self._require_cut()
        except Diverged as divergence:
            self._differ(str(divergence))
        if self._feed.failure is not None:
            raise self._feed.failure
        self._result.end_us = self._tape.time_us
        return self._result

    def _execute(self) -> None:
        description = self._recording.description
        tape, tracker = self._tape, PlayedTracker(self._feed.samples)
        clock = PlayedClock(tape, tracker, realtime=not is_simulated(self._recording.options))
        operator = PlayedOperator(tape)
        session = _session(self._recording)
        options = self._recording.options
        device, checks = parse_device_uri(options.device), options.effective_checks
        motion = motion_check(options, self._controller, description, self._recording.reference)
        try:
            clock.idle()  # while the board and the camera were connected
            client = Client(
                PlayedTransport(tape, self._feed.taken(self._feed.received)),
                clock,
                session,
                motors=description.robot.motors,
                on_frame=self._compare,
            )
            with client, self._difference_kept(), played_end(tape):
                clock.attach(client)
                meet_board(client, description, device)
                clock.idle()  # until the camera was tracking
                rig = Rig(clock, client, tracker, Tape(lambda _: None))
                with stopping_at_once(operator, clock, client, Observers()):
                    PathRun(
                        rig,
                        self._controller,
                        self._recording.reference,
                        description,
                        Observers(),
                        self._count_step,
                        operator,
                        markers=None if checks == "none" else MarkerCheck(description),
                        motion=motion,
                    ).execute()
        except (CcrError, KeyboardInterrupt):
            return  # as the recorded run ended

    @contextmanager
    def _difference_kept(self) -> Iterator[None]:
        """Keep the cause of a difference before the client, which disarms, shows its effect."""
        try:
            yield
        except Diverged as divergence:
            self._differ(str(divergence))
            raise

    def _compare(self, direction: str, time_us: int, data: bytes) -> None:
        if direction != "sent":
            return
        recorded = next(self._sent, None)
        # The tape of a killed run may end before its frames.
        if recorded is None or self._tape.head is None:
            self._require_cut(f"now {told_frame(data)}, recorded nothing more")
            raise TapeEnd
        expected = bytes.fromhex(recorded.content["hex"])
        if data != expected:
            self._diverge(f"recorded {told_frame(expected)}, now {told_frame(data)}")
        if time_us != recorded.time_us:
            told = told_frame(data)
            self._diverge(f"{told}: recorded at {recorded.time_us} us, now {time_us} us")
        if not self._tape.take_if(Token.SENT):
            self._tape.refuse("sends a frame")
        self._result.frames += 1

    def _count_step(self, step: int, steps: int, record: StepRecord) -> None:
        self._result.steps += 1

    def _require_end(self) -> None:
        left = next(self._sent, None)
        if left is not None:
            self._differ(
                f"recorded {told_frame(bytes.fromhex(left.content['hex']))}, now nothing more"
            )

    def _require_cut(self, what: str = "the host goes on where the recorded one had ended") -> None:
        if self._recording.end.is_complete:
            self._differ(what)

    def _diverge(self, what: str) -> NoReturn:
        self._differ(what)
        raise Diverged(what)

    def _differ(self, what: str) -> None:
        """Keep the first difference; what the host does after it means nothing."""
        if self._result.difference is None:
            self._result.difference = Difference(self._tape.time_us, self._result.steps, what)


def _session(recording: RunRecording) -> int:
    for message in recording.messages(topics.SENT):
        try:
            frame = decode_single_frame(bytes.fromhex(message.content["hex"]))
            if frame is not None and frame.id == OpenSession.ID:
                return OpenSession.unpack(frame.payload).session
        except (KeyError, ValueError, PayloadError):
            raise recording.foreign(f"messages on {message.topic}") from None
    return 1


def _piece(content: dict[str, Any]) -> TapePiece:
    times_us = list(accumulate(content["steps_us"], initial=content["start_us"]))[1:]
    errors = [TapeError(**error) for error in content["errors"]]
    return TapePiece(content["start_us"], content["tokens"], times_us, errors).checked()
