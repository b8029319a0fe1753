"""Tool definitions (.rom) of our own, and how they go to the device.

The layout is the publicly documented one of the 752-byte file; little endian. Without an enabled
passive tool a Polaris keeps its illuminators dark and sees no stray marker: the dummy is there to
switch them on. It has not met a real camera yet: one that refuses it at PINIT is given any .rom of
the lab's own instead.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import read_bytes

BLOCK_BYTES = 64
MEMORY_BYTES = 1024
"""Size of the virtual SROM; a shorter file is padded with zeros."""

_FILE_BYTES = 752
_MAGIC = b"NDI\0"
_CHECKSUM_AT = 4
_SUMMED_FROM = 6
_MARKERS_AT, _NORMALS_AT = 72, 312
_MANUFACTURER_AT, _MANUFACTURER_BYTES = 580, 12
_PART_NUMBER_AT, _PART_NUMBER_BYTES = 592, 20
_FACES_AT, _GROUPS_AT = 613, 633
_FACE_NORMAL_AT = 656

_NO_LED = 31
_TOOL_IN_PORT_ALWAYS = 9
_UNIQUE_GEOMETRY = 0x80
_PASSIVE_SPHERE = 41
_SUBTYPE_UNDEFINED = 2

DUMMY_MARKERS_MM = ((0.0, 0.0, 0.0), (0.0, 230.0, 0.0), (310.0, 0.0, 0.0), (0.0, -370.0, 90.0))
"""Every distance exceeds the robot's 125 mm and all four must be seen: it matches nothing."""


def make_passive_rom(markers_mm: Array, part_number: str) -> bytes:
    """Definition of a rigid body of passive spheres.

    Args:
        markers_mm: (n, 3) with n in 3..20; all of them must be seen.
        part_number: up to 20 ASCII characters.
    """
    count = len(markers_mm)
    rom = bytearray(_FILE_BYTES)
    rom[:4] = _MAGIC
    rom[8] = 1  # constant in every known file
    rom[12] = _SUBTYPE_UNDEFINED
    rom[20] = 1  # sequence number
    rom[24] = 90  # largest angle at which a marker counts, deg
    rom[28] = rom[32] = count
    struct.pack_into("<f", rom, 36, 2.0)  # largest 3D error of a marker, mm
    rom[_MARKERS_AT : _MARKERS_AT + 12 * count] = markers_mm.astype("<f4").tobytes()
    for marker in range(count):
        struct.pack_into("<3f", rom, _NORMALS_AT + 12 * marker, 0, 0, 1)
    rom[552 : 552 + count] = bytes(range(count))
    rom[572:576] = bytes([_NO_LED] * 4)
    rom[576] = _TOOL_IN_PORT_ALWAYS
    rom[_MANUFACTURER_AT : _MANUFACTURER_AT + _MANUFACTURER_BYTES] = b"ccr-host\0\0\0\0"
    part = part_number.encode("ascii").ljust(_PART_NUMBER_BYTES, b"\0")
    rom[_PART_NUMBER_AT : _PART_NUMBER_AT + _PART_NUMBER_BYTES] = part
    rom[612] = 9
    rom[_FACES_AT : _FACES_AT + count] = bytes([1] * count)
    rom[_GROUPS_AT : _GROUPS_AT + count] = bytes([1] * count)
    rom[653] = _UNIQUE_GEOMETRY
    rom[655] = _PASSIVE_SPHERE
    struct.pack_into("<3f", rom, _FACE_NORMAL_AT, 0, 0, 1)
    struct.pack_into("<H", rom, _CHECKSUM_AT, checksum(bytes(rom)))
    return bytes(rom)


def dummy_passive_rom() -> bytes:
    """A body that is never there; enabling it lights the illuminators."""
    return make_passive_rom(np.array(DUMMY_MARKERS_MM), "CCR-ILLUMINATE")


def checksum(rom: bytes) -> int:
    """Sum of all bytes behind the check sum, 16 bits."""
    return sum(rom[_SUMMED_FROM:_FILE_BYTES]) & 0xFFFF


def load_rom(path: Path) -> bytes:
    """Read a lab's own tool definition.

    Raises:
        ConfigError: no such file, or none of a passive tool's size and form.
    """
    rom = read_bytes(path, "tool definition", "give a .rom file", MEMORY_BYTES)
    if not rom.startswith(_MAGIC[:3]):
        raise ConfigError(f"tool definition {path}: not a .rom file", "make one with NDI Architect")
    if len(rom) < _FILE_BYTES:
        raise ConfigError(
            f"tool definition {path}: cut short, {len(rom)} of {_FILE_BYTES} bytes",
            "copy the file again",
        )
    if checksum(rom) != int.from_bytes(rom[4:6], "little"):
        raise ConfigError(f"tool definition {path}: wrong check sum", "copy the file again")
    return rom


def rom_blocks(rom: bytes) -> Iterator[tuple[int, bytes]]:
    """Address and 64 bytes of each block to upload, the last one padded with zeros."""
    for address in range(0, len(rom), BLOCK_BYTES):
        yield address, rom[address : address + BLOCK_BYTES].ljust(BLOCK_BYTES, b"\0")
