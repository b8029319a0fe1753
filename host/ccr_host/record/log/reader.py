"""Reads the log of a run, finished or not, whole or damaged."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Metadata
from pydantic import TypeAdapter, ValidationError

from ccr_host.control.base import Command, Outcome, Phase
from ccr_host.core import __version__
from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import is_folder, is_there, read_bytes
from ccr_host.description.schema import Description
from ccr_host.record.log import topics
from ccr_host.record.log.files import (
    END_RECORD,
    LOG_PREFIX,
    LOST_MESSAGES,
    NS_PER_US,
    TIMING_PREFIX,
    TROUBLE,
    file_number,
    log_files,
)
from ccr_host.record.log.mcap_parts import MOST_FILE_BYTES, Damage, McapParts, Part
from ccr_host.record.log.topics import LOG_TOPICS, SOLVE_TIME, TIMING_TOPICS, Topic, topics_of
from ccr_host.record.log.visuals import PHASE
from ccr_host.robot.reference import Reference
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.tracking.tracker import Sample

_NS_PER_S = 1e9
_REPEATED = frozenset(topic.name for topic in LOG_TOPICS if topic.repeated)
_CURE = "give the folder of a run, or one of its files"
_MOST_MESSAGE_BYTES = 16_000_000
"""The longest of ours is the picture of a path with 100 000 samples: 1.1 MB."""
_MOST_DAMAGES_TOLD = 3
_RUN_OPTIONS = TypeAdapter(RunOptions)


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One message of a log."""

    topic: str
    time_us: int
    content: dict[str, Any]


@dataclass(frozen=True)
class LogEnd:
    """How a log ends, and what is missing in it."""

    is_complete: bool
    """Whether the run has closed it; False during the run and after a kill."""
    lost_messages: int
    """Count in the closing record, or gaps in the sequence numbers of the messages present."""
    trouble: str = ""
    """What is wrong with the log, and where, in one line; empty if nothing is."""


class RunRecording:
    """The log of a run: its folder, or one of its files.

    A damaged file is read except for the records and chunks that are damaged themselves; `end`
    tells what is lost.

    Raises:
        ConfigError: there is no log, or it is not the log of a run.
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self._files = log_files(source, LOG_PREFIX) if is_folder(source) else [source]
        if not self._files or not is_there(source):
            raise _unusable(source, "No such file or directory" if self._files else "no log in it")

    def messages(self, *wanted: Topic) -> Iterator[LogMessage]:
        """Messages as they were written, of all topics or those wanted.

        What stands at the start of each file is given once.

        Raises:
            ConfigError: a file cannot be read, or holds what is no message of ours.
        """
        yield from self._read(self.topics, {topic.name for topic in wanted or LOG_TOPICS})

    @cached_property
    def topics(self) -> Sequence[Topic]:
        """What the log consists of; of any robot, if the setup cannot be read."""
        try:
            return topics_of(self.description.robot)
        except ConfigError:
            return LOG_TOPICS

    def _read(self, ours: Sequence[Topic], names: set[str]) -> Iterator[LogMessage]:
        for path in self._files:
            given = set()
            for message in _messages(path, ours, names):
                given.add(message.topic)
                yield message
            names = names - (given & _REPEATED)

    def solve_times_us(self) -> dict[int, float]:
        """The controller's computing time by step; none in virtual time without the folder."""
        apart = log_files(self.source, TIMING_PREFIX) if is_folder(self.source) else []
        inside = (message.content for message in self.messages(topics.STEP))
        outside = (
            message.content
            for path in apart
            for message in _messages(path, TIMING_TOPICS, {SOLVE_TIME.name})
        )
        return {
            content["step"]: content["solve_us"]
            for content in (*inside, *outside)
            if "step" in content and content.get("solve_us") is not None
        }

    @cached_property
    def setup(self) -> dict[str, Any]:
        """What was run, and the versions that ran it."""
        for message in self._read(LOG_TOPICS, {topics.SETUP.name}):
            return message.content
        raise _unusable(self.source, self.end.trouble or "not the log of a run")

    @property
    def options(self) -> RunOptions:
        try:
            options = self.setup["options"]
            told = {**options, "overrides": tuple(options["overrides"])}
            RunOptions(**told)  # which knows whether there are too many
            return _RUN_OPTIONS.validate_python(told)
        except (KeyError, TypeError, ConfigError, ValidationError):
            raise self.foreign("options") from None

    @cached_property
    def description(self) -> Description:
        try:
            return Description.model_validate(self.setup["description"])
        except (KeyError, ValidationError):
            raise self.foreign("a robot description") from None

    @cached_property
    def reference(self) -> Reference:
        """The desired path, as the controller got it.

        Raises:
            ConfigError: this is a later file of a log, without the path's samples.
        """
        pieces = [message.content for message in self.messages(topics.REFERENCE)]
        try:
            about = self.setup["reference"]
            columns = {
                name: np.array([row for piece in pieces for row in piece[name]], dtype=np.float64)
                for name in ("time_s", "target_mm", "q_rad", "unavoidable_mm")
            }
            name, samples, period_s = about["name"], about["samples"], about["period_s"]
        except KeyError:
            raise self.foreign("a desired path") from None
        if not samples or {samples} != {len(column) for column in columns.values()}:
            raise _unusable(self.source, self.end.trouble or "the desired path is not in it")
        laps, in_space = about.get("laps", 1), about.get("in_space", False)
        return Reference(name, period_s=period_s, laps=laps, in_space=in_space, **columns)

    def foreign(self, what: str) -> ConfigError:
        """Error for content that this version does not understand."""
        writer = self.setup.get("versions", {}).get("ccr_host", "unknown")
        return _unusable(
            self.source,
            f"written by ccr-host {writer}, with {what} that {__version__} does not know",
        )

    @cached_property
    def end(self) -> LogEnd:
        """Whether the log is whole; reads all of it."""
        account = _Account(self._files)
        for path in self._files:
            account.add(path)
        return account.end()


class _Account:
    """Counts what of a log is there, file by file."""

    def __init__(self, files: Sequence[Path]) -> None:
        numbers = [file_number(path) for path in files]
        missing = set(range(numbers[0], numbers[-1])) - set(numbers)
        self._troubles = [f"the log lacks its file number {min(missing)}"] if missing else []
        self._counts_from_start = numbers[0] == 0
        self._sequences: dict[str, int] = {}
        self._gaps = self._unread = 0
        self._closing: Metadata | None = None
        self._is_finished = self._is_cut = self._is_lower_bound = False

    def add(self, path: Path) -> None:
        """Look through the next file."""
        parts, time_s, messages = _parts(path), 0.0, 0
        damages: list[str] = []
        for part, topic in _with_topics(parts, LOG_TOPICS):
            if isinstance(part, Message):
                messages += 1
                time_s = part.log_time / _NS_PER_S
                self._count(topic, part.sequence)
            elif isinstance(part, Metadata) and part.name == END_RECORD:
                self._closing = part
            elif isinstance(part, Damage) and part.reaches_end and not parts.is_finished:
                self._is_cut = True
                where = f"byte {part.start} of {path.name}, {time_s:.2f} s into the run"
                self._troubles.append(
                    f"the log is cut off at {where}: its end was not copied, "
                    "or the disk was full and the run never closed its log"
                )
            elif isinstance(part, Damage):
                why = f" ({part.why})" if part.why else ""
                where = f"bytes {part.start} to {part.end} of {path.name}"
                damages.append(f"{where}, {time_s:.2f} s into the run{why}")
        if damages:
            more = len(damages) - _MOST_DAMAGES_TOLD
            told = " and ".join(damages[:_MOST_DAMAGES_TOLD]) + f" and {more} more" * (more > 0)
            self._troubles.append(f"the log is damaged: {told}")
        self._is_finished = parts.is_finished
        if parts.message_count is not None:
            self._unread += max(0, parts.message_count - messages)
        elif damages:
            self._is_lower_bound = True

    def end(self) -> LogEnd:
        """Sum up what was counted."""
        closing = {} if self._closing is None else self._closing.metadata
        told, copied_with = closing.get(LOST_MESSAGES, ""), closing.get(TROUBLE, "")
        never_written = int(told) if told.isdecimal() else 0
        lost = max(self._gaps, self._unread + never_written)
        if self._closing is None and self._is_finished:
            self._troubles.append("the log goes on in another file, or lacks its closing record")
        elif self._closing is None and not self._is_cut:
            self._troubles.append("the run never closed its log: it was killed, or goes on")
        if copied_with:
            self._troubles.append(f"copied from a log that was not whole ({copied_with})")
        elif lost:
            at_least = "at least " * self._is_lower_bound
            self._troubles.append(f"{at_least}{lost} messages were lost")
        is_complete = self._closing is not None and not copied_with
        return LogEnd(is_complete, lost, "; ".join(self._troubles))

    def _count(self, topic: str, sequence: int) -> None:
        """The messages of a topic are numbered from 1; 0 are those that every file begins with."""
        last = self._sequences.get(topic, 0 if self._counts_from_start else sequence - 1)
        if sequence > last:
            self._gaps += sequence - last - 1
            self._sequences[topic] = sequence


def _messages(path: Path, ours: Sequence[Topic], wanted: Collection[str]) -> Iterator[LogMessage]:
    by_name = {topic.name: topic for topic in ours if topic.name in wanted}
    for part, name in _with_topics(_parts(path), ours):
        if isinstance(part, Message) and name in by_name:
            content = _content(part, by_name[name], path)
            yield LogMessage(name, part.log_time // NS_PER_US, content)


def _content(message: Message, topic: Topic, path: Path) -> dict[str, Any]:
    if len(message.data) > _MOST_MESSAGE_BYTES:
        raise _unusable(path, f"a message on {topic.name} has {len(message.data)} bytes")
    try:
        content: dict[str, Any] = json.loads(message.data)
        if rb"\u" in message.data:  # half of a surrogate pair is no text that could be written
            json.dumps(content, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        content = {}
    if not content or not topic.is_message(content):
        time_s = message.log_time / _NS_PER_S
        raise _unusable(
            path,
            f"not the log of a run as ccr-host {__version__} knows it: "
            f"{topic.name} at {time_s:.3f} s",
        )
    return content


def _parts(path: Path) -> McapParts:
    parts = McapParts(read_bytes(path, "recording", _CURE, MOST_FILE_BYTES))
    if not parts.is_mcap:
        raise _unusable(path, "not an MCAP file")
    return parts


def _with_topics(parts: McapParts, ours: Sequence[Topic]) -> Iterator[tuple[Part, str]]:
    """The parts of a file, messages with their topics.

    Our own files number their channels like `ours`: where the record of a channel is damaged or
    lost, and there is no summary that repeats it, its number tells its topic.
    """
    found = {number: channel.topic for number, channel in parts.channels.items()}
    own = {number: topic.name for number, topic in enumerate(ours, 1)}
    names: dict[int, str] | None = None
    for part in parts:
        if isinstance(part, Channel):
            found.setdefault(part.id, part.topic)
            names = None
        elif isinstance(part, Message):
            if names is None:
                others = sum(own.get(number) != name for number, name in found.items())
                names = own if parts.is_ours and others <= 1 else found
            yield part, names.get(part.channel_id, str(part.channel_id))
        else:
            yield part, ""


def _unusable(path: Path, why: str) -> ConfigError:
    return ConfigError(f"recording {path}: {why}", _CURE)


_SHOWN = (topics.SENT, topics.RECEIVED, topics.SAMPLE, topics.CONTROL, topics.STEP, topics.EVENT)


def play_run(source: Path, observer: RunObserver) -> None:
    """Show a recorded run, all at once.

    The observer gets the same calls as in the run.

    Raises:
        ConfigError: there is no log of a run that can be read.
    """
    recording = RunRecording(source)
    observer.begin(RunSetup(recording.options, recording.description, recording.reference))
    solve_us = recording.solve_times_us()
    try:
        for message in recording.messages(*_SHOWN):
            _show(message, observer, solve_us)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"recording {source}: a message of another version ({error})",
            "view it with the version that has written it",
        ) from None


def _show(message: LogMessage, observer: RunObserver, solve_us: dict[int, float]) -> None:
    content, time_us = message.content, message.time_us
    match message.topic:
        case topics.SENT.name:
            observer.frame("sent", time_us, bytes.fromhex(content["hex"]))
        case topics.RECEIVED.name:
            observer.frame("received", time_us, bytes.fromhex(content["hex"]))
        case topics.SAMPLE.name:
            markers_mm = np.array(content["markers_mm"], dtype=np.float64)  # None becomes NaN
            observer.tracker_sample(time_us, Sample(content["exposed_us"], markers_mm))
        case topics.CONTROL.name:
            observer.control(time_us, None, _command(content))
        case topics.STEP.name:
            observer.step(_step(content, time_us, solve_us.get(content["step"], 0.0)))
        case topics.EVENT.name if content["name"] == PHASE:
            observer.phase(time_us, Phase(content["message"]))
        case topics.EVENT.name:
            observer.event(time_us, content["message"])


def _command(content: dict[str, Any]) -> Command:
    return Command(
        q_rad=np.array(content["command_rad"]),
        predicted_mm=np.array(content["predicted_mm"]).reshape(-1, 3),
        outcome=Outcome(content["outcome"]),
        detail=content["detail"],
        ramp_s=content["ramp_s"],
    )


def _step(content: dict[str, Any], end_us: int, solve_us: float) -> StepRecord:
    return StepRecord(
        step=content["step"],
        end_us=end_us,
        time_s=content["time_s"],
        target_mm=np.array(content["target_mm"]),
        q_rad=np.array(content["q_rad"]),
        outcome=Outcome(content["outcome"]),
        detail=content["detail"],
        predicted_mm=np.empty((0, 3)),
        solve_us=solve_us,
        late=content["late"],
        measured_mm=_position(content["measured_mm"]),
        measured_age_us=content["measured_age_us"],
        true_mm=_position(content["true_mm"]),
    )


def _position(numbers: list[float] | None) -> Array | None:
    return None if numbers is None else np.array(numbers)
