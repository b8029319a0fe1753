"""CRC-16/X-25, why this one: see the framing chapter of protocol/reference.md."""

from __future__ import annotations

from typing import Final

from ccr_host.crc16 import crc16, reflected_table

_TABLE: Final = reflected_table(0x8408)  # x^16 + x^12 + x^5 + 1, least significant bit first
_INITIAL = 0xFFFF
_FINAL_XOR = 0xFFFF


def crc16_x25(data: bytes) -> int:
    """CRC of `data`; that of "123456789" is 0x906E."""
    return crc16(data, _TABLE, _INITIAL) ^ _FINAL_XOR
