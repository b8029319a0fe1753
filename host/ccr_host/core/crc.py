"""The two checksums on the wires: CRC-16/X-25 of the board's frames, CRC-16/ARC of the Polaris."""

from __future__ import annotations

from typing import Final

Table = tuple[int, ...]


def reflected_table(polynomial_reflected: int) -> Table:
    """Lookup table of a reflected CRC, one entry per byte value, (256,)."""
    return tuple(_after_a_byte(byte, polynomial_reflected) for byte in range(256))


def crc16(data: bytes, table: Table, initial: int) -> int:
    """CRC of ``data`` before any final inversion."""
    crc = initial
    for byte in data:
        crc = (crc >> 8) ^ table[(crc ^ byte) & 0xFF]
    return crc


def _after_a_byte(crc: int, polynomial_reflected: int) -> int:
    for _ in range(8):
        crc = (crc >> 1) ^ polynomial_reflected if crc & 1 else crc >> 1
    return crc


_X25_TABLE: Final = reflected_table(0x8408)  # x^16 + x^12 + x^5 + 1, least significant bit first
_INITIAL = 0xFFFF
_FINAL_XOR = 0xFFFF


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25 of `data`; check value for "123456789": 0x906E."""
    return crc16(data, _X25_TABLE, _INITIAL) ^ _FINAL_XOR


_ARC_TABLE: Final = reflected_table(0xA001)  # x^16 + x^15 + x^2 + 1, least significant bit first


def crc16_arc(data: bytes) -> int:
    """CRC-16/ARC of `data`; check value for "123456789": 0xBB3D."""
    return crc16(data, _ARC_TABLE, 0)
