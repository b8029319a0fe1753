"""The wire format in its plainest form, driven by the spec.

The generator computes golden vectors and the worked example with it. Product code never uses it:
the host frames with the `cobs` package, the firmware with its own C++; independent packages
confirm every vector.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ccr_protocol.spec import FRAME_OVERHEAD, Field, Framing

Value: TypeAlias = "int | Sequence[int]"

_CRC_POLYNOMIAL_REFLECTED = 0x8408
_COBS_FULL_BLOCK = 0xFF


class EncodingError(ValueError):
    """Bytes that are not COBS."""


@dataclass(frozen=True)
class Frame:
    """A frame with a good CRC."""

    id: int
    sequence: int
    payload: bytes


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25 (ISO-HDLC, as in HDLC and PPP), one bit at a time."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_CRC_POLYNOMIAL_REFLECTED if crc & 1 else 0)
    return crc ^ 0xFFFF


def cobs_encode(data: bytes) -> bytes:
    """Replace every zero by the distance to the next one."""
    encoded = bytearray()
    block = bytearray()
    for byte in data:
        if byte:
            block.append(byte)
        if not byte or len(block) == _COBS_FULL_BLOCK - 1:
            encoded += bytes([len(block) + 1]) + block
            block.clear()
    return bytes(encoded + bytes([len(block) + 1]) + block)


def cobs_decode(data: bytes) -> bytes:
    """Undo `cobs_encode`.

    Raises:
        EncodingError: a zero inside, or a code byte that points beyond the end.
    """
    decoded = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        block = data[at + 1 : at + code]
        if code == 0 or 0 in block or len(block) != code - 1:
            raise EncodingError
        decoded += block
        at += code
        if code != _COBS_FULL_BLOCK and at < len(data):
            decoded.append(0)
    return bytes(decoded)


def frame_content(frame: Frame) -> bytes:
    """Id, sequence number, payload and CRC, before encoding."""
    content = bytes([frame.id, frame.sequence]) + frame.payload
    return content + crc16_x25(content).to_bytes(2, "little")


def encode_frame(frame: Frame) -> bytes:
    """Bytes on the wire, with the delimiter."""
    return cobs_encode(frame_content(frame)) + b"\0"


def decode_stream(stream: bytes, framing: Framing) -> Iterator[Frame | str]:
    """Tell what a receiver makes of a stream that starts between frames.

    Yields:
        Frames, and the names of the counters that the others go to. What follows the last
        zero is not yet a frame.
    """
    *chunks, _ = stream.split(b"\0")
    for chunk in chunks:
        if chunk:
            yield _decode_chunk(chunk, framing)


def _decode_chunk(chunk: bytes, framing: Framing) -> Frame | str:
    if len(chunk) > framing.max_encoded:
        return "bad_size"
    try:
        content = cobs_decode(chunk)
    except EncodingError:
        return "bad_encoding"
    if not FRAME_OVERHEAD <= len(content) <= framing.max_decoded:
        return "bad_size"
    body, crc = content[:-2], content[-2:]
    if crc16_x25(body).to_bytes(2, "little") != crc:
        return "bad_crc"
    return Frame(body[0], body[1], body[2:])


def pack(fields: Sequence[Field], values: Mapping[str, Value]) -> bytes:
    """Fields in their order, each little-endian."""
    return b"".join(
        element.to_bytes(field.type.size, "little", signed=field.type.signed)
        for field in fields
        for element in elements(values[field.name])
    )


def unpack(fields: Sequence[Field], payload: bytes) -> dict[str, Value]:
    """Undo `pack`; the payload has the right length."""
    values: dict[str, Value] = {}
    at = 0
    for field in fields:
        size = field.type.size
        numbers = [
            int.from_bytes(payload[start : start + size], "little", signed=field.type.signed)
            for start in range(at, at + field.size, size)
        ]
        values[field.name] = numbers if field.is_array else numbers[0]
        at += field.size
    return values


def elements(value: Value) -> Sequence[int]:
    """See a single integer as an array of one."""
    return [value] if isinstance(value, int) else value
