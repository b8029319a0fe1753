"""Status bits of TX replies, and what they mean to a person."""

from __future__ import annotations

from enum import IntFlag


class SystemStatus(IntFlag):
    """Last four digits of a TX reply. Bits 8 and 9 are the Polaris', Aurora has none there."""

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


class PortStatus(IntFlag):
    """Eight digits after a tool's transform."""

    OCCUPIED = 1 << 0
    INITIALISED = 1 << 4
    ENABLED = 1 << 5
    OUT_OF_VOLUME = 1 << 6
    PARTIALLY_OUT_OF_VOLUME = 1 << 7


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
