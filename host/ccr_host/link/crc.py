"""CRC-16/X-25, why this one: see the framing chapter of protocol/reference.md."""

from __future__ import annotations

from typing import Final

_POLYNOMIAL_REFLECTED = 0x8408  # x^16 + x^12 + x^5 + 1, least significant bit first
_INITIAL = 0xFFFF
_FINAL_XOR = 0xFFFF


def _table_entry(index: int) -> int:
    crc = index
    for _ in range(8):
        crc = (crc >> 1) ^ _POLYNOMIAL_REFLECTED if crc & 1 else crc >> 1
    return crc


_TABLE: Final = tuple(_table_entry(index) for index in range(256))


def crc16_x25(data: bytes) -> int:
    """CRC of `data`; that of "123456789" is 0x906E."""
    crc = _INITIAL
    table = _TABLE
    for byte in data:
        crc = (crc >> 8) ^ table[(crc ^ byte) & 0xFF]
    return crc ^ _FINAL_XOR
