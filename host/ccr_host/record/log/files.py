"""The files of one log, cut so that each opens alone and none is unwieldy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from errno import ENOENT
from pathlib import Path

from ccr_host.record.log.mcap_file import Chunk, McapFile
from ccr_host.record.log.topics import Topic

LOG_PREFIX = "log"
TIMING_PREFIX = "timing"
FILE_BYTES = 64_000_000
FILE_US = 3_600_000_000
"""An hour of 20 Hz operation is about 64 MB and still opens at once in a viewer."""
END_RECORD = "ccr_host.end"
"""Name of the metadata record that closes the last file."""
LOST_MESSAGES = "lost_messages"
TROUBLE = "copied_with"
"""Its key."""

_NS_PER_US = 1000


class LogFiles:
    """Files ``<prefix>_0000.mcap`` and so on.

    Where a file ends depends on its chunks alone. The first is made with the first chunk. After an
    error, such as a full disk, nothing more is written but the end of what is there.

    Args:
        folder: of the files.
        prefix: of the files' names.
        topics: all that will be written; numbered as in :class:`McapFile`.
        file_bytes: a file that has grown so large gets no further chunk.
        file_us: neither does one that spans so much of the run's clock.
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
        self._finished: list[McapFile] = []
        self._start_ns = 0
        self._file: McapFile | None = None
        self.error: OSError | None = None
        """What has ended the log early."""
        self.lost = 0
        """Messages that were not written, or whose file is gone."""

    def write(self, chunk: Chunk, repeated: Mapping[int, bytes]) -> None:
        """Add a chunk, in a new file if the present one is full; count it as lost after an error.

        Args:
            chunk: with at least one message.
            repeated: what every file begins with, by channel; as it stood before the chunk.
        """
        if self.error is None:
            try:
                self._write(chunk, repeated)
            except OSError as error:
                self.error = error
        if self.error is not None:
            self.lost += chunk.messages

    def close(self, skipped: int = 0, trouble: str = "") -> None:
        """Finish the last file.

        Args:
            skipped: messages that were never given to :meth:`write`, for the closing record.
            trouble: of the log that this is a copy of, for the closing record.
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
        opening.add(channel, 0, time_ns, content)
    return opening


def log_files(folder: Path, prefix: str) -> list[Path]:
    """The files of a log, in order."""
    return sorted(folder.glob(f"{prefix}_[0-9]*.mcap"), key=file_number)


def file_number(path: Path) -> int:
    """Place of a file in its log, from 0."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0
