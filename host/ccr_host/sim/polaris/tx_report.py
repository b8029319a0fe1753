"""Replies to TX as text, from what an image shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.sim.polaris.faults import BitOrder

Array = NDArray[np.float64]

TRANSFORMS = 0x0001
OUTSIDE_VOLUME_TOO = 0x0800
PASSIVE_STRAYS = 0x1000
SUPPORTED_MODE = TRANSFORMS | OUTSIDE_VOLUME_TOO | PASSIVE_STRAYS

MAX_STRAYS = 50
_PORT_OUT_OF_VOLUME = 0x40


@dataclass(frozen=True, eq=False)
class ToolLine:
    """A tool in a frame; without position it is missing."""

    handle: int
    status: int
    frame: int
    position_mm: Array | None = None
    quaternion: Array | None = None
    in_volume: bool = True


@dataclass(frozen=True, eq=False)
class StrayList:
    """Single markers of a frame: (n, 3) and (n,)."""

    positions_mm: Array
    in_volume: NDArray[np.bool_]


def format_tx(
    mode: int,
    tools: Sequence[ToolLine],
    strays: StrayList,
    system_status: int,
    bit_order: BitOrder,
) -> str:
    """Payload of the reply for a reply mode."""
    parts = [f"{len(tools):02X}"]
    parts += [_tool(tool, mode) for tool in tools]
    if mode & PASSIVE_STRAYS:
        parts.append(_strays(strays, bool(mode & OUTSIDE_VOLUME_TOO), bit_order))
    parts.append(f"{system_status:04X}")
    return "".join(parts)


def _tool(tool: ToolLine, mode: int) -> str:
    text = f"{tool.handle:02X}"
    if mode & TRANSFORMS:
        status = tool.status
        hidden = not (tool.in_volume or mode & OUTSIDE_VOLUME_TOO)
        if tool.position_mm is None or tool.quaternion is None:
            text += "MISSING"
        else:
            status |= _PORT_OUT_OF_VOLUME * (not tool.in_volume)
            text += "MISSING" if hidden else _transform(tool.quaternion, tool.position_mm)
        text += f"{status:08X}{tool.frame:08X}"
    return text + "\n"


def _transform(quaternion: Array, position_mm: Array) -> str:
    ratios = "".join(f"{round(float(q) * 10_000):+06d}" for q in quaternion)
    return ratios + _position(position_mm) + "+00900"


def _strays(strays: StrayList, outside_too: bool, bit_order: BitOrder) -> str:
    shown = np.ones(len(strays.in_volume), dtype=bool) if outside_too else strays.in_volume
    outside = ~strays.in_volume[shown][:MAX_STRAYS]
    positions_mm = strays.positions_mm[shown][:MAX_STRAYS]
    digits = -(-len(outside) // 4)
    ordered = outside if bit_order is BitOrder.FIRST_IS_HIGHEST else outside[::-1]
    bits = int("".join("1" if bit else "0" for bit in ordered) or "0", 2)
    text = f"{len(outside):02X}" + (f"{bits:0{digits}X}" if digits else "")
    return text + "".join(_position(position_mm) for position_mm in positions_mm)


def _position(position_mm: Array) -> str:
    return "".join(f"{round(float(value) * 100):+07d}" for value in position_mm)
