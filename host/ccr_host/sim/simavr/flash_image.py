"""Flash images, from ELF or Intel HEX files."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

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


def _read_elf(content: bytes) -> FlashImage:
    if content[:6] != _ELF_MAGIC or struct.unpack_from("<H", content, 18)[0] != _EM_AVR:
        raise ValueError("built for another machine")
    programs_at, sections_at, flags = struct.unpack_from("<3I", content, 28)
    board = _BOARDS.get(flags & _ARCHITECTURE)
    if board is None:
        raise ValueError("built for another AVR")
    programs, _, sections = struct.unpack_from("<3H", content, 44)
    segments = tuple(
        (address, content[offset : offset + size])
        for kind, offset, _, address, size, *_ in _table("<8I", content, programs_at, programs)
        if kind == _PT_LOAD and size and address < _DATA_SPACE
    )
    if not segments:
        raise ValueError("contains no program")
    symbols: dict[str, int] = {}
    headers = list(_table("<10I", content, sections_at, sections))
    for _, kind, _, _, offset, size, link, *_ in headers:
        if kind == _SHT_SYMTAB:
            symbols |= _symbols(content[offset : offset + size], content[headers[link][4] :])
    return FlashImage(segments, symbols, board)


def _table(entry: str, content: bytes, at: int, count: int) -> Iterator[tuple[int, ...]]:
    return struct.iter_unpack(entry, content[at : at + count * struct.calcsize(entry)])


def _symbols(table: bytes, names: bytes) -> Iterator[tuple[str, int]]:
    for begin, value in struct.iter_unpack("<II8x", table):
        if begin:
            name = names[begin : names.index(b"\0", begin)].decode("ascii", "replace")
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
