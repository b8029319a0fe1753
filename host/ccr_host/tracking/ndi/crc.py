"""CRC-16/ARC, the check sum of the NDI protocol."""

from __future__ import annotations

from typing import Final

from ccr_host.crc16 import crc16, reflected_table

_TABLE: Final = reflected_table(0xA001)  # x^16 + x^15 + x^2 + 1, least significant bit first


def crc16_arc(data: bytes) -> int:
    """CRC of `data`; that of "123456789" is 0xBB3D."""
    return crc16(data, _TABLE, 0)
