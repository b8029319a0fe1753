"""The two checksums on the wires: CRC-16/X-25 of the board's frames, CRC-16/ARC of the Polaris."""

from __future__ import annotations

from functools import partial
from typing import Final

Table = tuple[int, ...]


def reflected_table(polynomial_reflected: int) -> Table:
    """Lookup table of a reflected CRC, one entry per byte value, (256,)."""
    return tuple(_after_a_byte(byte, polynomial_reflected) for byte in range(256))


def crc16(data: bytes, table: Table, initial: int, final_xor: int) -> int:
    """CRC of ``data`` by a lookup table."""
    crc = initial
    for byte in data:
        crc = (crc >> 8) ^ table[(crc ^ byte) & 0xFF]
    return crc ^ final_xor


def _after_a_byte(crc: int, polynomial_reflected: int) -> int:
    for _ in range(8):
        crc = (crc >> 1) ^ polynomial_reflected if crc & 1 else crc >> 1
    return crc


_X25_TABLE: Final = reflected_table(0x8408)  # x^16 + x^12 + x^5 + 1, least significant bit first
_ARC_TABLE: Final = reflected_table(0xA001)  # x^16 + x^15 + x^2 + 1, least significant bit first

crc16_x25 = partial(crc16, table=_X25_TABLE, initial=0xFFFF, final_xor=0xFFFF)
"""CRC-16/X-25 of bytes; check value for "123456789": 0x906E."""
crc16_arc = partial(crc16, table=_ARC_TABLE, initial=0, final_xor=0)
"""CRC-16/ARC of bytes; check value for "123456789": 0xBB3D."""
