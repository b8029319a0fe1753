"""CRC-16 with the least significant bit first, as both serial protocols have it."""

from __future__ import annotations

Table = tuple[int, ...]


def reflected_table(polynomial_reflected: int) -> Table:
    """What each byte does to a CRC, (256,)."""
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
