"""Reads an MCAP file as far as it is intact, and reports which parts are not.

The package's own reader gives up at the first byte that is wrong, and believes every length that a
file states. This one goes on at the next record that can be told from noise: a damaged byte costs
the record or chunk in which it stands. Records are parsed by the package.
Layout: https://mcap.dev/spec
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from struct import Struct
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import CRCValidationError, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError, frame_content_size

MOST_FILE_BYTES = 256_000_000
"""Four times what the files of our logs are cut at."""
_MOST_CHUNK_BYTES = 64_000_000
"""Unpacked; ours end at 4 MB and the message that is added then."""
_MOST_UNPACKED_BYTES = 2_000_000_000
"""Limit on the sum of all chunks of a file."""

_HEADER_BYTES = 64

_HEAD = Struct("<BQ")
_FOOTER = Struct("<BQQQI")
_PARSED: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
    Opcode.DATA_END: DataEnd,
    Opcode.STATISTICS: Statistics,
}
_UNPARSABLE = (EndOfFile, struct.error, UnicodeDecodeError)
_LANDMARK = re.compile(
    rb"\x06.{36}\x04\0\0\0zstd|\x0c.{8}\x0c\0\0\0ccr_host\.end|\x0f\x04\0{11}[\x03\x0b]", re.DOTALL
)
"""Starts of a chunk, of the closing record, of the end of the data with the summary behind it: the
numbers of an index may look like the former alone."""


@dataclass(frozen=True)
class Damage:
    """A range of bytes that cannot be read."""

    start: int
    end: int
    why: str = ""
    reaches_end: bool = False
    """Whether nothing after it can be read."""


Part = Channel | Metadata | Message | Damage


class McapParts:
    """The content of one file."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.is_finished = data.endswith(MCAP0_MAGIC) and len(data) > len(MCAP0_MAGIC)
        """Whether the writer has closed the file."""
        self.channels: dict[int, Channel] = {}
        """The channels that the summary lists."""
        self.message_count: int | None = None
        """The count in the summary; None without a summary that can be trusted."""
        for record in self._summary():
            if isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Statistics):
                self.message_count = record.message_count

    @property
    def is_mcap(self) -> bool:
        """Whether this is an MCAP file, perhaps a damaged one."""
        return self._data.startswith(MCAP0_MAGIC) or self._landmark(0) is not None

    @property
    def is_ours(self) -> bool:
        """Whether the header, perhaps a damaged one, names this program as the writer."""
        return b"ccr-host" in self._data[:_HEADER_BYTES]

    def __iter__(self) -> Iterator[Part]:
        """Yield everything readable in front of the summary, in order."""
        at, unpacked_bytes = len(MCAP0_MAGIC), 0
        while at < len(self._data):
            record = self._record(at)
            if record is None:
                landmark = self._landmark(at + 1)
                end = len(self._data) if landmark is None else landmark
                yield Damage(at, end, reaches_end=landmark is None)
                at = end
                continue
            parsed, end = record
            if isinstance(parsed, DataEnd):
                return
            if isinstance(parsed, Chunk):
                records, why = _unpacked(parsed)
                unpacked_bytes += 0 if why else parsed.uncompressed_size
                if unpacked_bytes > _MOST_UNPACKED_BYTES:
                    why = f"more than {_MOST_UNPACKED_BYTES} bytes unpacked"
                if why:
                    yield Damage(at, end, why)
                else:
                    yield from (one for one in records if isinstance(one, Channel | Message))
            elif isinstance(parsed, Channel | Metadata):
                yield parsed
            at = end

    def _summary(self) -> Iterator[object]:
        """Records of the summary; none if its check sum is wrong."""
        footer_at = len(self._data) - len(MCAP0_MAGIC) - _FOOTER.size
        if not self.is_finished or footer_at < 0:
            return
        opcode, length, at, _, crc = _FOOTER.unpack_from(self._data, footer_at)
        if opcode != Opcode.FOOTER or length != _FOOTER.size - _HEAD.size or not 0 < at < footer_at:
            return
        if crc != zlib.crc32(memoryview(self._data)[at : footer_at + _FOOTER.size - 4]):
            return
        while at + _HEAD.size <= footer_at:
            opcode, length = _HEAD.unpack_from(self._data, at)
            start, at = at + _HEAD.size, at + _HEAD.size + length
            if opcode in (Opcode.CHANNEL, Opcode.STATISTICS):
                yield _parsed(opcode, self._data[start:at])

    def _record(self, at: int) -> tuple[McapRecord, int] | None:
        """The record in front of the summary that begins here, and its end; None if none can."""
        if at + _HEAD.size > len(self._data):
            return None
        opcode, length = _HEAD.unpack_from(self._data, at)
        start, end = at + _HEAD.size, at + _HEAD.size + length
        if end > len(self._data):
            return None
        record = _parsed(opcode, self._data[start:end])
        return None if record is None else (record, end)

    def _landmark(self, at: int) -> int | None:
        """Find the start of the next record that is certainly one."""
        for found in _LANDMARK.finditer(self._data, at):
            if self._record(found.start()) is not None:
                return found.start()
        return None


class _Whole(ReadDataStream):
    """Refuses to return less than the length that was asked for."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def _parsed(opcode: int, content: bytes) -> McapRecord | None:
    """The record; None if it is of another kind, or the content is not exactly one."""
    if opcode not in _PARSED:
        return None
    stream = _Whole(BytesIO(content))
    try:
        record: McapRecord = _PARSED[opcode].read(stream)
    except _UNPARSABLE:
        return None
    return record if stream.count == len(content) else None


def _unpacked(chunk: Chunk) -> tuple[list[McapRecord], str]:
    """The records of a chunk, or why they cannot be had."""
    if chunk.compression not in ("zstd", ""):
        return [], f"compressed with {chunk.compression!r}"
    try:
        packed = chunk.data
        size = frame_content_size(packed) if chunk.compression else len(packed)
        if not (size == chunk.uncompressed_size <= _MOST_CHUNK_BYTES):
            return [], "a chunk that is too large, or of another size than it says"
        return breakup_chunk(chunk, validate_crc=True), ""
    except CRCValidationError:
        return [], "wrong check sum"
    except ZstdError as error:
        return [], str(error)
    except _UNPARSABLE:
        return [], "a record in it is not whole"
