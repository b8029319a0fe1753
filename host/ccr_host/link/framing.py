"""Frames on the wire: `id u8, sequence u8, payload, crc u16`, COBS-encoded, closed by a zero."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from cobs import cobs

from ccr_host.core.wire import crc16_x25
from ccr_host.link.messages import FRAME_DELIMITER, FRAME_OVERHEAD, MAX_AXES, MAX_PAYLOAD

_DELIMITER = bytes([FRAME_DELIMITER])
_HEADER_BYTES = 2
_CRC_BYTES = 2


@dataclass(frozen=True, slots=True)
class Frame:
    """A complete, valid frame."""

    id: int
    sequence: int
    payload: bytes


class FramingError(Enum):
    """Why the bytes between two zeros are not a valid frame."""

    BAD_CRC = "bad_crc"
    BAD_ENCODING = "bad_encoding"
    BAD_SIZE = "bad_size"


def encode_frame(message_id: int, sequence: int, payload: bytes) -> bytes:
    """Encode a frame, including the closing zero."""
    body = bytes((message_id, sequence)) + payload
    encoded: bytes = cobs.encode(body + crc16_x25(body).to_bytes(_CRC_BYTES, "little"))
    return encoded + _DELIMITER


class FrameDecoder:
    """Finds the frames in a byte stream; buffers at most one unfinished frame.

    ``max_payload`` is by default that of any board.
    """

    def __init__(self, max_payload: int = MAX_PAYLOAD.of(MAX_AXES)) -> None:
        self._max_encoded = max_payload + FRAME_OVERHEAD + 1
        self._unfinished = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[Frame | FramingError]:
        """Add received bytes; returns the frames and errors that they complete, in order."""
        found: list[Frame | FramingError] = []
        *completed, rest = data.split(_DELIMITER)
        for part in completed:
            self._append(part)
            if self._too_long:
                found.append(FramingError.BAD_SIZE)
            elif self._unfinished:
                found.append(_decode(bytes(self._unfinished), self._max_encoded - 1))
            self.reset()
        self._append(rest)
        return found

    def reset(self) -> None:
        """Discard the unfinished frame."""
        self._unfinished.clear()
        self._too_long = False

    def _append(self, part: bytes) -> None:
        if self._too_long:
            return
        if len(self._unfinished) + len(part) > self._max_encoded:
            self._unfinished.clear()
            self._too_long = True
        else:
            self._unfinished += part


def decode_single_frame(data: bytes) -> Frame | None:
    """Decode bytes, including the closing zero; None unless they are exactly one valid frame."""
    found = FrameDecoder().feed(data)
    return found[0] if len(found) == 1 and isinstance(found[0], Frame) else None


def _decode(encoded: bytes, max_decoded: int) -> Frame | FramingError:
    try:
        decoded = cobs.decode(encoded)
    except cobs.DecodeError:
        return FramingError.BAD_ENCODING
    if not FRAME_OVERHEAD <= len(decoded) <= max_decoded:
        return FramingError.BAD_SIZE
    body, crc = decoded[:-_CRC_BYTES], decoded[-_CRC_BYTES:]
    if crc16_x25(body) != int.from_bytes(crc, "little"):
        return FramingError.BAD_CRC
    return Frame(body[0], body[1], body[_HEADER_BYTES:])
