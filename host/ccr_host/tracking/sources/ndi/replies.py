"""Replies to `TX:1801`: tools, frame numbers, strays with out-of-volume bits, system status.

    count, then for each handle: handle, (transform | MISSING | DISABLED), port status, frame, LF
    stray count, out-of-volume bits, strays
    system status

The grammar is strict: any other reply is rejected as a whole.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.core.errors import TrackerError
from ccr_host.core.wire import crc16_arc
from ccr_host.tracking.sources.ndi.device_errors import meaning_of
from ccr_host.tracking.tracker import Pose

CR = b"\r"
_CRC_DIGITS = 4
_CRC_FORM = re.compile(rb"[0-9A-F]{4}")
_TEXT_FORM = re.compile(rb"[\n\x20-\x7e]*")
_REFUSAL_FORM = re.compile(r"ERROR([0-9A-F]{2})")

LONGEST_REPLY_BYTES = 8192
"""Several times the longest TX reply: 50 strays and 9 tools take 1.8 kB."""


class DamagedReplyError(TrackerError):
    """The bytes are not a complete, correct reply."""

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
    line = line.lstrip(b"\n")
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
        """Replies completed by `data`; one that gets too long is discarded."""
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
        return bytes(self._rest)

    def clear(self) -> None:
        """Discard an unfinished reply."""
        self._rest.clear()


class SystemStatus(IntFlag):
    """System status, the last four digits of a TX reply. Aurora does not use bits 8 and 9."""

    SYNC_ERROR = 1 << 0
    EXTERNAL_INFRARED = 1 << 1
    CRC_ERROR = 1 << 2
    RECOVERABLE_EXCEPTION = 1 << 3
    HARDWARE_FAILURE = 1 << 4
    HARDWARE_CHANGE = 1 << 5
    PORT_OCCUPIED = 1 << 6
    PORT_UNOCCUPIED = 1 << 7
    DIAGNOSTIC_PENDING = 1 << 8
    TEMPERATURE = 1 << 9


_WARNINGS = {
    SystemStatus.SYNC_ERROR: "the camera lost synchronisation; power it off and on",
    SystemStatus.EXTERNAL_INFRARED: "too much infrared light; shade lamps and the sun",
    SystemStatus.CRC_ERROR: "the camera's internal link has errors; check its cables",
    SystemStatus.RECOVERABLE_EXCEPTION: "the camera recovered from an error by itself",
    SystemStatus.HARDWARE_FAILURE: "hardware failure of the camera; have it serviced",
    SystemStatus.HARDWARE_CHANGE: "the camera's hardware has changed; power it off and on",
    SystemStatus.DIAGNOSTIC_PENDING: "diagnostics pending (was it bumped?); run NDI's self-test",
    SystemStatus.TEMPERATURE: "outside its operating temperature; let it warm up or cool down",
}


def system_warnings(status: SystemStatus) -> tuple[str, ...]:
    """One readable line for each bit that deserves attention."""
    return tuple(text for bit, text in _WARNINGS.items() if status & bit)


Pair = tuple[float, float]


@dataclass(frozen=True)
class MeasurementVolume:
    """Frustum along -z of the camera's frame, with half widths in x and y."""

    near_z_mm: float
    near_half_mm: Pair
    far_z_mm: float
    far_half_mm: Pair

    def contains(self, points_mm: ArrayLike) -> BoolArray:
        """Whether each point, (n, 3), is inside or on the boundary, (n,)."""
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
        depth = (points[:, 2] - self.near_z_mm) / (self.far_z_mm - self.near_z_mm)
        near, far = np.array(self.near_half_mm), np.array(self.far_half_mm)
        half_mm = near + depth[:, None] * (far - near)
        inside: BoolArray = (
            (depth >= 0) & (depth <= 1) & (np.abs(points[:, :2]) <= half_mm).all(axis=1)
        )
        return inside


VICRA = MeasurementVolume(
    near_z_mm=-557.0, near_half_mm=(196.0, 246.0), far_z_mm=-1336.0, far_half_mm=(443.5, 469.0)
)
"""Polaris Vicra: 392 x 491 mm at the near end, 887 x 938 mm at the far one. Depths and near end
are known, the far corners are the maker's figures as remembered: compare them with your manual."""


REPLY_MODE = "1801"
"""Transforms (0001) and strays (1000), also outside the volume (0800): we check that ourselves."""

MAX_STRAYS = 50
_UNITS_PER_ONE = 10_000
"""Scale of quaternions and errors."""
_UNITS_PER_MM = 100
_NORM_TOLERANCE = 0.01
"""Rounding to 1e-4 moves the norm of a quaternion by 1e-4 at most."""

_RATIO_CHARS = 6
_COORDINATE_CHARS = 7
_MARKER_CHARS = 3 * _COORDINATE_CHARS
_HEX_2 = re.compile(r"[0-9A-F]{2}")
_TOOL = re.compile(
    r"(?P<handle>[0-9A-F]{2})"
    r"(?:UNOCCUPIED|"
    r"(?:(?P<q>(?:[+-][0-9]{5}){4})(?P<t>(?:[+-][0-9]{6}){3})(?P<error>[+-][0-9]{5})"
    r"|(?:MISSING|DISABLED))"
    r"[0-9A-F]{8}(?P<frame>[0-9A-F]{8}))\n"
)
_STRAYS = re.compile(r"(?P<bits>[0-9A-F]*)(?P<markers>(?:[+-][0-9]{6})*)")
"""The bits are not used, as their assignment to strays is disputed."""
_STATUS = re.compile(r"[0-9A-F]{4}")


@dataclass(frozen=True, eq=False)
class ToolReport:
    """One tool in one frame."""

    handle: int
    frame: int | None
    """Counts at 60 Hz from TSTART; None for an unoccupied handle."""
    pose: Pose | None = None
    """None if it is missing, disabled or unoccupied."""


@dataclass(frozen=True, eq=False)
class TxReply:
    """One parsed reply."""

    tools: tuple[ToolReport, ...]
    strays_mm: Array
    """(n, 3), in the camera's frame."""
    system_status: SystemStatus

    @property
    def frame(self) -> int | None:
        """Newest frame number of the tools, as strays have none; None without tools."""
        return max((tool.frame for tool in self.tools if tool.frame is not None), default=None)


def parse_tx(text: str) -> TxReply:
    """Parse a reply whose CRC has been checked and removed.

    Raises:
        DamagedReplyError: anything but one whole reply of this grammar.
    """
    count, at = _hex_byte(text, 0, "tool count")
    tools = []
    for _ in range(count):
        match = _TOOL.match(text, at)
        if match is None:
            raise DamagedReplyError("tool report")
        tools.append(_tool(match))
        at = match.end()
    stray_count, at = _hex_byte(text, at, "stray count")
    if stray_count > MAX_STRAYS:
        raise DamagedReplyError(f"{stray_count} strays, a device sends up to {MAX_STRAYS}")
    bits_end = at + (stray_count + 3) // 4
    strays_end = bits_end + stray_count * _MARKER_CHARS
    match = _STRAYS.fullmatch(text, at, strays_end)
    if match is None or match.end("bits") != bits_end or not _STATUS.fullmatch(text, strays_end):
        raise DamagedReplyError("strays or system status")
    return TxReply(
        tools=tuple(tools),
        strays_mm=_decimals(match["markers"], _COORDINATE_CHARS, _UNITS_PER_MM).reshape(-1, 3),
        system_status=SystemStatus(int(text[strays_end:], 16)),
    )


def _tool(match: re.Match[str]) -> ToolReport:
    handle = int(match["handle"], 16)
    frame = int(match["frame"], 16) if match["frame"] else None
    if not match["q"]:
        return ToolReport(handle, frame)
    quaternion = _decimals(match["q"], _RATIO_CHARS, _UNITS_PER_ONE)
    if abs(float(quaternion @ quaternion) - 1) > _NORM_TOLERANCE:
        raise DamagedReplyError("a quaternion that is not of unit length")
    pose = Pose(
        position_mm=_decimals(match["t"], _COORDINATE_CHARS, _UNITS_PER_MM),
        quaternion=quaternion,
        error_mm=int(match["error"]) / _UNITS_PER_ONE,
    )
    return ToolReport(handle, frame, pose)


def _hex_byte(text: str, at: int, what: str) -> tuple[int, int]:
    match = _HEX_2.match(text, at)
    if match is None:
        raise DamagedReplyError(what)
    return int(match[0], 16), match.end()


def _decimals(text: str, width: int, units_per_one: int) -> Array:
    numbers = [int(text[at : at + width]) for at in range(0, len(text), width)]
    return np.array(numbers, dtype=np.float64) / units_per_one
