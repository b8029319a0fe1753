"""Sinks that write messages to the files of a log, at once or from a background thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from threading import Condition, Lock, Thread
from typing import Protocol

from pydantic_core import to_json

from ccr_host.core.errors import why
from ccr_host.core.stop_signals import signals_deferred
from ccr_host.record.log import visuals
from ccr_host.record.log.files import NS_PER_US, Chunk, LogFiles, Packed
from ccr_host.record.log.topics import EVENT, Topic

QUEUE_CHUNKS = 60
"""Most chunks that wait for the disk. At one chunk a second this is how long a disk may stall."""
CHUNK_US = 850_000
"""A chunk is closed after so long on the run's clock.

With the tenth of a second that inputs wait for theirs, a kill costs less than a second."""
CHUNK_BYTES = 4_000_000

_CLOSE_AFTER_S = 0.85
"""The same in real time, for a control loop that hangs and logs nothing more."""


class Sink(Protocol):
    """Takes the messages of a log; never raises."""

    def write(self, topic: Topic, time_us: int, content: bytes) -> None:
        """Add one message."""

    def close(self) -> None:
        """Write what is left, and close the files."""

    @property
    def trouble(self) -> str:
        """What is missing in the log and why; empty if nothing is."""
        ...


Taken = tuple[Chunk, dict[int, bytes]]
"""A chunk, and what a file that begins with it has to begin with, by channel."""


class _Packer:
    """Packs messages into chunks; where a chunk ends depends on the messages alone."""

    def __init__(self, topics: Sequence[Topic]) -> None:
        self.chunk = Chunk()
        self._channels = {topic.name: number for number, topic in enumerate(topics, 1)}
        self._sequences = [0] * (len(topics) + 1)
        self._repeated: dict[int, bytes] = {}
        self._repeated_in_chunk: dict[int, bytes] = {}
        self._due_us: int | None = None

    def add(self, topic: Topic, time_us: int, content: bytes) -> Taken | None:
        """Pack one message; gives the chunk before it if that is full."""
        full = None
        if self._due_us is None:
            self._due_us = time_us + CHUNK_US
        elif time_us >= self._due_us or self.chunk.size >= CHUNK_BYTES:
            full = self.take()
            self._due_us = time_us + CHUNK_US
        channel = self._channels[topic.name]
        sequence = self._sequences[channel] = self._sequences[channel] + 1
        if topic.repeated:
            self._repeated_in_chunk[channel] = content
        self.chunk.add(Packed(channel, sequence, time_us * NS_PER_US, content))
        return full

    def take(self) -> Taken | None:
        """The chunk as it is; None if it is empty."""
        if not self.chunk.messages:
            return None
        taken = self.chunk, dict(self._repeated)
        self._repeated |= self._repeated_in_chunk
        self._repeated_in_chunk.clear()
        self.chunk = Chunk()
        self._due_us = None
        return taken


class DirectSink:
    """Writes in the caller's thread: in virtual time a slow disk delays nothing."""

    def __init__(self, files: LogFiles, topics: Sequence[Topic]) -> None:
        self._files = files
        self._packer = _Packer(topics)

    @property
    def trouble(self) -> str:
        return _trouble(self._files.error, self._files.lost)

    def write(self, topic: Topic, time_us: int, content: bytes) -> None:
        self._write_chunk(self._packer.add(topic, time_us, content))

    def close(self, skipped: int = 0, trouble: str = "") -> None:
        self._write_chunk(self._packer.take())
        self._files.close(skipped, trouble)

    def _write_chunk(self, taken: Taken | None) -> None:
        if taken is not None:
            with signals_deferred():
                self._files.write(*taken)


class BackgroundSink:
    """Packs in the caller's thread; another one compresses and writes within a second.

    If the disk stalls until the queue is full, chunks are skipped; the log says where as soon as it
    can be written again. Once the disk is full nothing more is written. Either way the loss is
    counted, recorded in the closing record, and reported to the user through ``trouble``. It is the
    only writer of its files, which know the same topics.
    """

    def __init__(
        self, files: LogFiles, topics: Sequence[Topic], queue_chunks: int = QUEUE_CHUNKS
    ) -> None:
        self._files = files
        self._packer = _Packer(topics)
        self._queue_chunks = queue_chunks
        self._queue: deque[Taken] = deque()
        self._lock = Lock()
        self._wake = Condition(self._lock)
        self._closing = False
        self._skipped = 0
        self._skipped_told = 0
        self._thread = Thread(target=self._run, name="log writer", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> str:
        return _trouble(self._files.error, self._files.lost + self._skipped)

    def write(self, topic: Topic, time_us: int, content: bytes) -> None:
        with self._lock:
            full = self._packer.add(topic, time_us, content)
            if full is not None:
                self._enqueue(full)
                self._tell_skipped(time_us)
                self._wake.notify()

    def close(self) -> None:
        with self._lock:
            self._closing = True
            self._wake.notify()
        self._thread.join()

    def _enqueue(self, taken: Taken) -> None:
        if len(self._queue) >= self._queue_chunks:
            self._skipped += len(taken[0].messages)
        else:
            self._queue.append(taken)

    def _tell_skipped(self, time_us: int) -> None:
        if self._skipped > self._skipped_told and len(self._queue) < self._queue_chunks:
            text = f"log: {self._skipped - self._skipped_told} messages lost before this"
            self._skipped_told = self._skipped
            note = visuals.log_message(time_us, visuals.WARNING, text)
            self._packer.add(EVENT, time_us, to_json(note))

    def _run(self) -> None:
        while self._write_next():
            pass
        self._files.close(self._skipped)

    def _write_next(self) -> bool:
        """Wait for a chunk and write it; False after the last."""
        with self._lock:
            if not self._queue and not self._closing:
                self._wake.wait(_CLOSE_AFTER_S)
            taken = self._queue.popleft() if self._queue else self._packer.take()
            if taken is None:
                return not self._closing
        self._files.write(*taken)
        return True


def _trouble(error: OSError | None, lost: int) -> str:
    if error is not None:
        return f"the log is incomplete: {why(error)}, {lost} messages lost"
    return f"the log lacks {lost} messages: the disk was too slow" if lost else ""
