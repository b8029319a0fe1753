"""Flash images, from ELF or Intel HEX files."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, NamedTuple

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import read_bytes

BoardName = Literal["uno", "mega2560"]
_CHECKOUT = Path(__file__).parents[4]
_UNO_AXES = 2


def board_for(motors: int) -> BoardName:
    """The smallest board that drives so many servos."""
    return "uno" if motors <= _UNO_AXES else "mega2560"


def released_firmware(board: BoardName) -> Path:
    """The file that scripts/release puts into the package; missing in a checkout."""
    return Path(__file__).parents[2] / "firmware" / f"{board}.hex"


def find_firmware(given: str = "", board: BoardName = "uno") -> Path:
    """The firmware's ELF or HEX file: the given one, else the build of `pio run`, else the release.

    Raises:
        ConfigError: there is none.
    """
    if given:
        return Path(given)
    built = Path(f".pio/build/{board}/firmware.elf")
    for file in (Path.cwd() / built, _CHECKOUT / built, released_firmware(board)):
        if file.exists():
            return file
    raise ConfigError(
        f"simavr: no firmware binary {built}",
        f"build it with pio run -e {board}, or write simavr:FILE.elf",
    )


def cache_folder() -> Path:
    """Folder for files that are built on this machine on demand."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ccr-host"


FLASH_BYTES: Final[dict[BoardName, int]] = {"uno": 32 * 1024, "mega2560": 256 * 1024}
_BOARDS: Final[dict[int, BoardName]] = {5: "uno", 6: "mega2560"}
"""Boards by the architecture that is in the flags of an ELF file: avr5, avr6."""
_ARCHITECTURE: Final = 0x7F
_MOST_BYTES = 16_000_000
"""Enough for an ELF file with debugging information."""
_ELF_MAGIC = b"\x7fELF\x01\x01"
"""32 bits, little-endian."""
_EM_AVR = 83
_PT_LOAD = 1
_SHT_SYMTAB = 2
_DATA_SPACE = 0x800000
"""Offset of the data address space in avr-gcc's linker."""


@dataclass(frozen=True)
class FlashImage:
    """Bytes for the flash.

    Attributes:
        segments: byte address and content of each segment.
        symbols: byte addresses by name: functions in flash, variables in the data space; empty
            unless read from an ELF file.
        board: the board that it is for.
    """

    segments: tuple[tuple[int, bytes], ...]
    symbols: dict[str, int] = field(default_factory=dict)
    board: BoardName = "uno"

    @property
    def start(self) -> int:
        """Lowest address."""
        return min(address for address, _ in self.segments)


def read_flash_image(path: Path, board: BoardName = "uno") -> FlashImage:
    """Read an ELF or HEX file, recognised by its content.

    ``board`` is what a HEX file is for, as it does not say so.

    Raises:
        ConfigError: the file cannot be read, is not for one of the boards, or is too long for it.
    """
    content = read_bytes(path, "firmware", "build it first: pio run", _MOST_BYTES)
    try:
        image = _read_elf(content) if content[:4] == _ELF_MAGIC[:4] else _read_hex(content, board)
    except (ValueError, IndexError, struct.error) as error:
        raise ConfigError(
            f"firmware {path}: neither an ELF file for AVR nor Intel HEX ({error})",
            "give firmware.elf or firmware.hex of a build for the board",
        ) from None
    room = FLASH_BYTES[image.board]
    if any(address + len(data) > room for address, data in image.segments):
        raise ConfigError(
            f"firmware {path}: longer than {room} bytes", f"build it for {image.board}"
        )
    return image


class _Section(NamedTuple):
    kind: int
    offset: int
    size: int
    link: int
    entry_size: int


def _read_elf(content: bytes) -> FlashImage:
    if content[:6] != _ELF_MAGIC or struct.unpack_from("<H", content, 18)[0] != _EM_AVR:
        raise ValueError("built for another machine")
    (flags,) = struct.unpack_from("<I", content, 36)
    board = _BOARDS.get(flags & _ARCHITECTURE)
    if board is None:
        raise ValueError("built for another AVR")
    program_offset, section_offset = struct.unpack_from("<II", content, 28)
    program_size, program_count, section_size, section_count = struct.unpack_from(
        "<4H", content, 42
    )
    segments = []
    for index in range(program_count):
        kind, offset, _, address, size = struct.unpack_from(
            "<5I", content, program_offset + index * program_size
        )
        if kind == _PT_LOAD and size and address < _DATA_SPACE:
            segments.append((address, content[offset : offset + size]))
    if not segments:
        raise ValueError("contains no program")
    sections = [
        _section(content, section_offset + index * section_size) for index in range(section_count)
    ]
    symbols = {
        name: address
        for section in sections
        if section.kind == _SHT_SYMTAB
        for name, address in _symbols(content, section, sections[section.link])
    }
    return FlashImage(tuple(segments), symbols, board)


def _section(content: bytes, at: int) -> _Section:
    _, kind, _, _, offset, size, link, _, _, entry_size = struct.unpack_from("<10I", content, at)
    return _Section(kind, offset, size, link, entry_size)


def _symbols(content: bytes, table: _Section, names: _Section) -> Iterator[tuple[str, int]]:
    for at in range(table.offset, table.offset + table.size, table.entry_size):
        name_offset, value = struct.unpack_from("<II", content, at)
        if name_offset:
            begin = names.offset + name_offset
            name = content[begin : content.index(b"\0", begin)].decode("ascii", "replace")
            yield name, value - _DATA_SPACE if value >= _DATA_SPACE else value


_HEX_DATA = 0
_HEX_END = 1
_HEX_SEGMENT = 2
_HEX_LINEAR = 4


def _read_hex(content: bytes, board: BoardName) -> FlashImage:
    segments: list[tuple[int, bytes]] = []
    base = 0
    for number, line in enumerate(content.decode("ascii").split(), start=1):
        record = bytes.fromhex(line.removeprefix(":"))
        if line[0] != ":" or sum(record) % 256 != 0 or len(record) != record[0] + 5:
            raise ValueError(f"line {number} is damaged")
        address, kind = struct.unpack_from(">HB", record, 1)
        data = record[4:-1]
        if kind == _HEX_DATA:
            segments.append((base + address, data))
        elif kind == _HEX_SEGMENT:
            base = int.from_bytes(data) << 4
        elif kind == _HEX_LINEAR:
            base = int.from_bytes(data) << 16
        elif kind == _HEX_END:
            break
    if not segments:
        raise ValueError("contains no program")
    return FlashImage(tuple(segments), board=board)
