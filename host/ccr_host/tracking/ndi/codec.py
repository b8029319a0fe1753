"""Commands and replies as bytes: pure functions, and the splitter of the incoming stream.

`CMD:args<CRC>CR` and `<data><CRC>CR`, CRC as four upper-case hexadecimal digits.
"""

from __future__ import annotations

import re

from ccr_host.errors import TrackerError
from ccr_host.tracking.ndi.crc import crc16_arc
from ccr_host.tracking.ndi.device_errors import meaning_of

CR = b"\r"
_CRC_DIGITS = 4
_CRC_FORM = re.compile(rb"[0-9A-F]{4}")
_TEXT_FORM = re.compile(rb"[\n\x20-\x7e]*")
_REFUSAL_FORM = re.compile(r"ERROR([0-9A-F]{2})")

LONGEST_REPLY_BYTES = 8192
"""Several times the longest TX reply: 50 strays and 9 tools take 1.8 kB."""


class DamagedReplyError(TrackerError):
    """Bytes that are not a whole, correct reply."""

    def __init__(self, cause: str, line: bytes = b"") -> None:
        self.line = line
        super().__init__(f"damaged reply: {cause}", "check cable and baud rate of the camera")


class CommandRefusedError(TrackerError):
    """The device answered with an error code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(*meaning_of(code))


def encode_command(name: str, arguments: str = "") -> bytes:
    """`name:arguments` with its CRC and a carriage return."""
    text = f"{name}:{arguments}".encode("ascii")
    return b"%s%04X\r" % (text, crc16_arc(text))


def decode_reply(line: bytes) -> str:
    """Payload of a reply without its carriage return.

    Raises:
        DamagedReplyError: too short, not text, or its CRC does not fit.
        CommandRefusedError: a correct reply that says `ERRORnn`.
    """
    data, crc = line[:-_CRC_DIGITS], line[-_CRC_DIGITS:]
    if not data or not _CRC_FORM.fullmatch(crc):
        raise DamagedReplyError("no check sum", line)
    if crc16_arc(data) != int(crc, 16):
        raise DamagedReplyError("wrong check sum", line)
    if not _TEXT_FORM.fullmatch(data):
        raise DamagedReplyError("not text", line)
    text = data.decode("ascii")
    if refusal := _REFUSAL_FORM.fullmatch(text):
        raise CommandRefusedError(int(refusal[1], 16))
    return text


class ReplySplitter:
    """Cuts a byte stream at the carriage returns."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Replies completed by `data`; one that grows beyond all bounds is thrown away."""
        self._rest += data
        if CR not in data:
            if len(self._rest) > LONGEST_REPLY_BYTES:
                self._rest.clear()
            return []
        *lines, rest = bytes(self._rest).split(CR)
        self._rest = bytearray(rest)
        return lines

    @property
    def unfinished(self) -> bytes:
        """What has come of an unfinished reply."""
        return bytes(self._rest)

    def clear(self) -> None:
        """Forget what has come of an unfinished reply."""
        self._rest.clear()
