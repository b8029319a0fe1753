"""CRC-16/ARC, the check sum of the NDI protocol."""

from __future__ import annotations

from typing import Final

_POLYNOMIAL_REFLECTED = 0xA001  # x^16 + x^15 + x^2 + 1, least significant bit first


def _table_entry(index: int) -> int:
    crc = index
    for _ in range(8):
        crc = (crc >> 1) ^ _POLYNOMIAL_REFLECTED if crc & 1 else crc >> 1
    return crc


_TABLE: Final = tuple(_table_entry(index) for index in range(256))


def crc16_arc(data: bytes) -> int:
    """CRC of `data`; that of "123456789" is 0xBB3D."""
    crc = 0
    table = _TABLE
    for byte in data:
        crc = (crc >> 8) ^ table[(crc ^ byte) & 0xFF]
    return crc
