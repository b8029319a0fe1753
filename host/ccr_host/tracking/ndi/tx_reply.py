"""Replies to `TX:1801`: tools, frame numbers, strays with out-of-volume bits, system status.

    count, then for each handle: handle, (transform | MISSING | DISABLED), port status, frame, LF
    stray count, out-of-volume bits, strays
    system status

The grammar is strict: a reply that is not exactly this is refused as a whole.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ccr_host.tracking.frame import FloatArray, Pose
from ccr_host.tracking.ndi.codec import DamagedReplyError
from ccr_host.tracking.ndi.status import PortStatus, SystemStatus

REPLY_MODE = "1801"
"""Transforms (0001) and strays (1000), also outside the volume (0800): we check that ourselves."""

MAX_STRAYS = 50
_UNITS_PER_ONE = 10_000
"""Of quaternions and errors."""
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
    r"|(?P<absent>MISSING|DISABLED))"
    r"(?P<status>[0-9A-F]{8})(?P<frame>[0-9A-F]{8}))\n"
)
_STRAYS = re.compile(r"(?P<bits>[0-9A-F]*)(?P<markers>(?:[+-][0-9]{6})*)")
_STATUS = re.compile(r"[0-9A-F]{4}")


_NO_STATUS = PortStatus(0)


class ToolState(Enum):
    """Why a tool has a pose or none."""

    TRACKED = "tracked"
    MISSING = "MISSING"
    DISABLED = "DISABLED"
    UNOCCUPIED = "UNOCCUPIED"


@dataclass(frozen=True, eq=False)
class ToolReport:
    """One tool in one frame."""

    handle: int
    state: ToolState
    status: PortStatus = _NO_STATUS
    frame: int | None = None
    """Counts at 60 Hz from TSTART; None for an unoccupied handle."""
    pose: Pose | None = None


@dataclass(frozen=True, eq=False)
class TxReply:
    """One parsed reply."""

    tools: tuple[ToolReport, ...]
    strays_mm: FloatArray
    """(n, 3), in the camera's frame."""
    out_of_volume_bits: int
    """As sent; which bit belongs to which stray is disputed, so nothing here depends on it."""
    system_status: SystemStatus

    @property
    def frame(self) -> int | None:
        """Newest frame number of any tool; strays have none of their own. None without tools."""
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
        out_of_volume_bits=int(match["bits"] or "0", 16),
        system_status=SystemStatus(int(text[strays_end:], 16)),
    )


def _tool(match: re.Match[str]) -> ToolReport:
    handle = int(match["handle"], 16)
    if match["status"] is None:
        return ToolReport(handle, ToolState.UNOCCUPIED)
    status, frame = PortStatus(int(match["status"], 16)), int(match["frame"], 16)
    if match["absent"]:
        return ToolReport(handle, ToolState(match["absent"]), status, frame)
    quaternion = _decimals(match["q"], _RATIO_CHARS, _UNITS_PER_ONE)
    if abs(float(quaternion @ quaternion) - 1) > _NORM_TOLERANCE:
        raise DamagedReplyError("a rotation that is none")
    pose = Pose(
        position_mm=_decimals(match["t"], _COORDINATE_CHARS, _UNITS_PER_MM),
        quaternion=quaternion,
        error_mm=int(match["error"]) / _UNITS_PER_ONE,
    )
    return ToolReport(handle, ToolState.TRACKED, status, frame, pose)


def _hex_byte(text: str, at: int, what: str) -> tuple[int, int]:
    match = _HEX_2.match(text, at)
    if match is None:
        raise DamagedReplyError(what)
    return int(match[0], 16), match.end()


def _decimals(text: str, width: int, units_per_one: int) -> FloatArray:
    numbers = [int(text[at : at + width]) for at in range(0, len(text), width)]
    return np.array(numbers, dtype=np.float64) / units_per_one
