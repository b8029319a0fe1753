"""The files of one log, split so that each can be opened alone and none is unwieldy."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from errno import ENOENT
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from mcap.writer import IndexType, Writer
from pydantic_core import to_json

from ccr_host.core import __version__
from ccr_host.record.log.topics import Topic

LOG_PREFIX = "log"
TIMING_PREFIX = "timing"
FILE_BYTES = 64_000_000
FILE_US = 3_600_000_000
"""An hour of 20 Hz operation is about 64 MB and still opens at once in a viewer."""
END_RECORD = "ccr_host.end"
"""Name of the metadata record that closes the last file."""
LOST_MESSAGES, TROUBLE = "lost_messages", "copied_with"
"""Keys of that record."""

NS_PER_US = 1000
_NO_LIMIT = 2**62
"""Chunks end where the log says, not where the package's writer would cut them."""


class Packed(NamedTuple):
    """One message as it will stand in a file."""

    channel: int
    sequence: int
    time_ns: int
    content: bytes


@dataclass
class Chunk:
    """Messages on their way into a file, which takes all of them or none."""

    messages: list[Packed] = field(default_factory=list)
    size: int = 0
    """Total size of their contents in bytes."""

    def add(self, message: Packed) -> None:
        self.messages.append(message)
        self.size += len(message.content)

    @property
    def start_ns(self) -> int:
        """Time of the earliest message."""
        return min(message.time_ns for message in self.messages)


class _AllOrNothing(BytesIO):
    """Collects what is written and hands it to the operating system when flushed.

    The operating system keeps it if we are killed. A disk that is full leaves the file as it was
    before the flush that fails.

    Raises:
        OSError: the disk is full or gone.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        path.parent.mkdir(parents=True, exist_ok=True)
        self.file = path.open("w+b", buffering=0)
        self.size = 0
        """Bytes in the file."""

    def tell(self) -> int:
        return self.size + super().tell()

    def flush(self) -> None:
        data = self.getvalue()
        self.seek(0)
        self.truncate()
        left = memoryview(data)
        try:
            while left:
                left = left[self.file.write(left) :]
        except OSError:
            with suppress(OSError):
                self.file.truncate(self.size)
                self.file.seek(self.size)
            raise
        self.size += len(data)


class McapFile:
    """A file with a channel for each topic, numbered from 1.

    Raises:
        OSError: from all methods; the disk is full or gone.
    """

    def __init__(self, path: Path, topics: Sequence[Topic]) -> None:
        self._path = path
        self._stream = _AllOrNothing(path)
        self._identity = os.fstat(self._stream.file.fileno())
        self.messages = 0
        """Number of messages written."""
        self._writer = Writer(self._stream, chunk_size=_NO_LIMIT)
        self._writer.start(library=f"ccr-host {__version__}")
        for topic in topics:
            schema = self._writer.register_schema(
                topic.schema_name, "jsonschema", to_json(topic.schema)
            )
            self._writer.register_channel(topic.name, "json", schema)
        try:
            self._flush()
        except OSError:
            self._stream.file.close()
            path.unlink()
            raise

    @property
    def size(self) -> int:
        return self._stream.size

    @property
    def is_there(self) -> bool:
        """Whether the file still has its name."""
        try:
            return os.path.samestat(self._path.stat(), self._identity)
        except OSError:
            return False

    def write_chunk(self, chunk: Chunk) -> None:
        for channel, sequence, time_ns, content in chunk.messages:
            self._writer.add_message(channel, time_ns, content, time_ns, sequence)
        self._flush()
        self.messages += len(chunk.messages)

    def write_metadata(self, name: str, content: Mapping[str, str]) -> None:
        self._writer.add_metadata(name, dict(content))
        self._flush()

    def finish(self) -> None:
        """Write the summary, by which readers find their way without reading all, and close.

        A file that was removed meanwhile is written again.
        """
        try:
            self._writer.finish()
            self._stream.flush()
            self._put_back()
        finally:
            self._stream.file.close()

    def _flush(self) -> None:
        try:
            self._writer.flush()
        except OSError:
            # The writer's index now names what is not in the file, which has to end without one.
            self._writer = Writer(
                self._stream,
                index_types=IndexType.NONE,
                repeat_channels=False,
                repeat_schemas=False,
                use_chunking=False,
                use_statistics=False,
                use_summary_offsets=False,
            )
            raise

    def _put_back(self) -> None:
        if self.is_there:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._stream.file.seek(0)
        with self._path.open("xb") as again:
            shutil.copyfileobj(self._stream.file, again)
            self._identity = os.fstat(again.fileno())


class LogFiles:
    """Files ``<prefix>_0000.mcap`` and so on.

    Where a file ends depends on its chunks alone. The first is made with the first chunk. After an
    error, such as a full disk, nothing more is written but the end of what is there. A file gets no
    further chunk once it has ``file_bytes``, or spans ``file_us`` of the run's clock. Topics are
    numbered as in :class:`McapFile`.
    """

    def __init__(
        self,
        folder: Path,
        prefix: str,
        topics: Sequence[Topic],
        *,
        file_bytes: int = FILE_BYTES,
        file_us: int = FILE_US,
    ) -> None:
        self._folder = folder
        self._prefix = prefix
        self._topics = topics
        self._file_bytes = file_bytes
        self._file_ns = file_us * NS_PER_US
        self._finished: list[McapFile] = []
        self._start_ns = 0
        self._file: McapFile | None = None
        self.error: OSError | None = None
        """The error that ended the log early."""
        self.lost = 0
        """Number of messages that were not written, or whose file is gone."""

    def write(self, chunk: Chunk, repeated: Mapping[int, bytes]) -> None:
        """Add a chunk, in a new file if the present one is full; count it as lost after an error.

        The chunk has at least one message; ``repeated`` is what every file begins with, by channel,
        as it stood before the chunk.
        """
        if self.error is None:
            try:
                self._write(chunk, repeated)
            except OSError as error:
                self.error = error
        if self.error is not None:
            self.lost += len(chunk.messages)

    def close(self, skipped: int = 0, trouble: str = "") -> None:
        """Finish the last file.

        For the closing record: ``skipped`` messages were never given to :meth:`write`; ``trouble``
        is that of the log that this is a copy of.
        """
        try:
            if self._file is None and self.error is None:
                self._file = self._next()
            if self._file is not None:
                end = {LOST_MESSAGES: str(self.lost + skipped)}
                self._file.write_metadata(END_RECORD, end | ({TROUBLE: trouble} if trouble else {}))
                self._finish(self._file)
        except OSError as error:
            self.error = self.error or error
        for file in self._finished:
            if not file.is_there:
                self.error = self.error or FileNotFoundError(ENOENT, "a file of it was removed")
                self.lost += file.messages

    def _write(self, chunk: Chunk, repeated: Mapping[int, bytes]) -> None:
        if self._file is not None and self._is_full(self._file, chunk):
            self._finish(self._file)
        if self._file is None:
            self._file = self._next()
            self._start_ns = chunk.start_ns
            if self._finished and repeated:
                self._file.write_chunk(_opening(repeated, chunk.start_ns))
        self._file.write_chunk(chunk)

    def _is_full(self, file: McapFile, chunk: Chunk) -> bool:
        is_long = chunk.start_ns - self._start_ns >= self._file_ns
        return is_long or file.size >= self._file_bytes

    def _next(self) -> McapFile:
        name = f"{self._prefix}_{len(self._finished):04d}.mcap"
        return McapFile(self._folder / name, self._topics)

    def _finish(self, file: McapFile) -> None:
        self._finished.append(file)
        self._file = None
        file.finish()


def _opening(repeated: Mapping[int, bytes], time_ns: int) -> Chunk:
    opening = Chunk()
    for channel, content in repeated.items():
        opening.add(Packed(channel, 0, time_ns, content))
    return opening


def log_files(folder: Path, prefix: str) -> list[Path]:
    """The files of a log, in order."""
    return sorted(folder.glob(f"{prefix}_[0-9]*.mcap"), key=file_number)


def file_number(path: Path) -> int:
    """Number of a file within its log, from 0."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0
