"""The files of one log, cut so that each opens alone and none is unwieldy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ccr_host.run.log.mcap_file import Chunk, McapFile
from ccr_host.run.log.topics import Topic

LOG_PREFIX = "log"
TIMING_PREFIX = "timing"
FILE_BYTES = 64_000_000
FILE_US = 3_600_000_000
"""An hour of 20 Hz operation is about 64 MB and still opens at once in a viewer."""
END_RECORD = "ccr_host.end"
"""Name of the metadata record that closes the last file."""

_NS_PER_US = 1000


class LogFiles:
    """Files ``<prefix>_0000.mcap`` and so on.

    Where a file ends depends on its chunks alone.

    Args:
        folder: exists.
        prefix: of the files' names.
        topics: all that will be written; numbered as in :class:`McapFile`.
        file_bytes: a file that has grown so large gets no further chunk.
        file_us: neither does one that spans so much of the run's clock.

    Raises:
        OSError: from all methods; the disk is full or gone.
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
        self._file_ns = file_us * _NS_PER_US
        self._files = 0
        self._start_ns: int | None = None
        self._file = self._next()

    def write(self, chunk: Chunk, repeated: Mapping[int, bytes]) -> None:
        """Add a chunk, in a new file if the present one is full.

        Args:
            chunk: with at least one message.
            repeated: what every file begins with, by channel; as it stood before the chunk.
        """
        if self._is_full(chunk):
            self._file.finish()
            self._file = self._next()
            self._start_ns = chunk.start_ns
            if repeated:
                self._file.write_chunk(_opening(repeated, chunk.start_ns))
        elif self._start_ns is None:
            self._start_ns = chunk.start_ns
        self._file.write_chunk(chunk)

    def close(self, end: Mapping[str, str]) -> None:
        """Finish the last file; ``end`` is kept in its closing record."""
        self._file.write_metadata(END_RECORD, end)
        self._file.finish()

    def _is_full(self, chunk: Chunk) -> bool:
        if self._start_ns is None:
            return False
        is_long = chunk.start_ns - self._start_ns >= self._file_ns
        return is_long or self._file.size >= self._file_bytes

    def _next(self) -> McapFile:
        path = self._folder / f"{self._prefix}_{self._files:04d}.mcap"
        self._files += 1
        return McapFile(path, self._topics)


def _opening(repeated: Mapping[int, bytes], time_ns: int) -> Chunk:
    opening = Chunk()
    for channel, content in repeated.items():
        opening.add(channel, 0, time_ns, content)
    return opening


def log_files(folder: Path, prefix: str) -> list[Path]:
    """The files of a log, in order."""
    return sorted(folder.glob(f"{prefix}_[0-9]*.mcap"), key=file_number)


def file_number(path: Path) -> int:
    """Place of a file in its log, from 0."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0
