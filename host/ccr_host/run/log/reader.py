"""Reads the log of a run, finished or not."""

from __future__ import annotations

import json
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from pydantic import ValidationError
from zstandard import ZstdError

import ccr_host
from ccr_host.config import Description
from ccr_host.errors import ConfigError
from ccr_host.robot.reference import Reference
from ccr_host.run.log import topics
from ccr_host.run.log.files import END_RECORD, LOG_PREFIX, TIMING_PREFIX, log_files
from ccr_host.run.log.sinks import LOST_MESSAGES
from ccr_host.run.log.topics import SOLVE_TIME, Topic
from ccr_host.run.options import RunOptions

_NS_PER_US = 1000
_REPEATED = frozenset(topic.name for topic in topics.LOG_TOPICS if topic.repeated)
_CUT_SHORT = (EOFError, struct.error, McapError)
"""What the package raises at the end of a file that nobody has finished."""
_DAMAGED = (CRCValidationError, ZstdError, UnicodeDecodeError)


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One message of a log."""

    topic: str
    time_us: int
    content: dict[str, Any]


@dataclass(frozen=True)
class LogEnd:
    """How a log ends."""

    is_complete: bool
    """Whether the run has closed it; not so while it lasts or after a kill."""
    lost_messages: int
    """As the closing record says."""


class RunRecording:
    """The log of a run: its folder, or one of its files.

    Raises:
        ConfigError: there is no log, or it is no log of a run.
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self._files = [source] if source.is_file() else log_files(source, LOG_PREFIX)
        if not self._files:
            missing = "no log in it" if source.is_dir() else "No such file or directory"
            raise _unusable(source, missing)

    def messages(self, *wanted: Topic) -> Iterator[LogMessage]:
        """Messages as they were written, of all topics or those wanted.

        An unfinished file gives all that is whole in it. What stands at the start of each file is
        given once.

        Raises:
            ConfigError: a file cannot be read, or is damaged.
        """
        names = {topic.name for topic in wanted} or {topic.name for topic in topics.LOG_TOPICS}
        for index, path in enumerate(self._files):
            yield from _messages(path, names - _REPEATED if index else names)

    def solve_times_us(self) -> dict[int, float]:
        """The controller's computing time by step; none in virtual time without the folder."""
        apart = log_files(self.source, TIMING_PREFIX) if self.source.is_dir() else []
        inside = (message.content for message in self.messages(topics.STEP))
        outside = (
            message.content for path in apart for message in _messages(path, {SOLVE_TIME.name})
        )
        return {
            content["step"]: content["solve_us"]
            for content in (*inside, *outside)
            if content.get("solve_us") is not None
        }

    @cached_property
    def setup(self) -> dict[str, Any]:
        """What was run, and the versions that ran it."""
        for message in self.messages(topics.SETUP):
            return message.content
        raise _unusable(self.source, "not the log of a run")

    @property
    def options(self) -> RunOptions:
        """As the run was told."""
        try:
            options = self.setup["options"]
            return RunOptions(**{**options, "overrides": tuple(options["overrides"])})
        except (KeyError, TypeError):
            raise self.foreign("options") from None

    @property
    def description(self) -> Description:
        """The robot that was run."""
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
        about = self.setup["reference"]
        if sum(len(piece["time_s"]) for piece in pieces) != about["samples"]:
            raise _unusable(self.source, "the desired path is not in it")
        columns = {
            name: np.array([row for piece in pieces for row in piece[name]], dtype=np.float64)
            for name in ("time_s", "target_mm", "q_rad", "unavoidable_mm")
        }
        laps = about.get("laps", 1)
        return Reference(about["name"], period_s=about["period_s"], laps=laps, **columns)

    def foreign(self, what: str) -> ConfigError:
        """What to raise for content that this version cannot make sense of."""
        writer = self.setup.get("versions", {}).get("ccr_host", "unknown")
        return _unusable(
            self.source,
            f"written by ccr-host {writer}, with {what} that {ccr_host.__version__} does not know",
        )

    @cached_property
    def end(self) -> LogEnd:
        """Whether the log is whole."""
        for record in _records(self._files[-1], emit_chunks=True):
            if isinstance(record, Metadata) and record.name == END_RECORD:
                return LogEnd(True, int(record.metadata[LOST_MESSAGES]))
        return LogEnd(False, 0)


def _messages(path: Path, names: Collection[str]) -> Iterator[LogMessage]:
    wanted: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Channel) and record.topic in names:
            wanted[record.id] = record.topic
        elif isinstance(record, Message) and record.channel_id in wanted:
            time_us = record.log_time // _NS_PER_US
            yield LogMessage(wanted[record.channel_id], time_us, _content(record, path))


def _content(record: Message, path: Path) -> dict[str, Any]:
    try:
        content = json.loads(record.data)
    except ValueError as error:
        raise _unusable(path, f"damaged: {error}") from None
    if not isinstance(content, dict):
        raise _unusable(path, "damaged: a message is no object")
    return content


def _records(path: Path, *, emit_chunks: bool = False) -> Iterator[McapRecord]:
    try:
        with path.open("rb") as file:
            yield from _whole_records(file, path, emit_chunks=emit_chunks)
    except OSError as error:
        raise _unusable(path, str(error.strerror)) from None


def _whole_records(file: IO[bytes], path: Path, *, emit_chunks: bool) -> Iterator[McapRecord]:
    records = StreamReader(file, validate_crcs=True, emit_chunks=emit_chunks).records
    is_log = False
    while True:
        try:
            record = next(records, None)
        except _CUT_SHORT:
            record = None
            if not is_log:
                raise _unusable(path, "not an MCAP file") from None
        except _DAMAGED as error:
            if file.read(1):
                raise _unusable(path, f"damaged: {error}") from None
            record = None  # the last chunk was only begun
        if record is None:
            return
        is_log = True
        yield record


def _unusable(path: Path, why: str) -> ConfigError:
    return ConfigError(f"recording {path}: {why}", "give the folder of a run, or one of its files")
