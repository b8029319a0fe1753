"""Units and checksums on the wire: angles in 0.01 deg, bytes of ten bits (8N1), CRCs."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import radians
from typing import Final

import numpy as np

from ccr_host.core.arrays import Array

CDEG_PER_DEG = 100
_BITS_PER_BYTE = 10
_US_PER_S = 1_000_000


def deg_to_cdeg(angle_deg: float) -> int:
    """Angle in units of 0.01 deg, rounded to nearest."""
    return round(angle_deg * CDEG_PER_DEG)


def rad_to_cdeg(angles_rad: Array) -> list[int]:
    """Nearest 0.01 deg of each angle.

    Raises:
        ValueError: not a finite number.
    """
    cdeg: list[float] = np.rint(np.degrees(angles_rad) * CDEG_PER_DEG).tolist()
    try:
        return list(map(int, cdeg))
    except (ValueError, OverflowError):
        raise ValueError(f"angles of {angles_rad} rad cannot be sent") from None


def cdeg_to_rad(angles_cdeg: Iterable[int]) -> Array:
    """Angles of all axes, rad, (axes,), from units of 0.01 deg."""
    return np.array([radians(angle / CDEG_PER_DEG) for angle in angles_cdeg])


def wire_time_us(count: int, baud: int) -> int:
    """Transmission time of `count` bytes, us, rounded up."""
    return -(-count * _BITS_PER_BYTE * _US_PER_S // baud)


def bytes_in(time_us: int, baud: int) -> int:
    """Number of whole bytes transmitted in `time_us`."""
    return time_us * baud // (_BITS_PER_BYTE * _US_PER_S)


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
