"""The EEPROM in memory or in a file, and what it stores: fault log, configuration, boot counter."""

from __future__ import annotations

import struct
from binascii import crc32
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import reduce
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Self, TypeVar

from ccr_host.core.errors import ConfigError, why
from ccr_host.core.user_file import replacing
from ccr_host.link.messages import (
    EEPROM_BOOT_COUNTER,
    EEPROM_BOOT_COUNTERS,
    EEPROM_LAYOUT,
    EEPROM_MAGIC,
    EEPROM_SIZE,
    EEPROM_SLOT_A,
    EEPROM_SLOT_B,
    FAULT_LOG_ADDRESS,
    FAULT_LOG_RECORDS,
    Acceleration,
    Calibration,
    ConfigGroups,
    EepromStatus,
    Equipment,
    FaultRecord,
    Limits,
    Slew,
    Watchdog,
    eeprom_slot_size,
)

_CRC = struct.Struct("<I")
_U16 = 1 << 16
_HALF_U16 = 1 << 15
T = TypeVar("T")


class FaultLog:
    """The fault records: finds the newest one, writes the next byte by byte."""

    def __init__(self, eeprom: EepromImage) -> None:
        self._eeprom = eeprom
        self._unwritten = b""
        good = [
            record.number
            for place in range(FAULT_LOG_RECORDS)
            if is_good(record := self.at(place)) and record.number % FAULT_LOG_RECORDS == place
        ]
        newest = next(
            (n for n in good if all(n == other or _is_newer(n, other) for other in good)), None
        )
        self._next_number = 0 if newest is None else (newest + 1) % _U16

    def at(self, place: int) -> FaultRecord:
        """The record at this place, valid or not."""
        address = FAULT_LOG_ADDRESS + place * FaultRecord.SIZE
        return FaultRecord.unpack(self._eeprom.read(address, FaultRecord.SIZE))

    @property
    def is_writing(self) -> bool:
        return bool(self._unwritten)

    def begin(self, record: FaultRecord) -> None:
        """Start writing a record; its number and check are filled in here."""
        record = replace(record, number=self._next_number)
        self._unwritten = replace(record, check=_check_of(record)).pack()

    def advance(self) -> None:
        """Write the next byte, if any is left."""
        if not self._unwritten:
            return
        place = self._next_number % FAULT_LOG_RECORDS
        end = FAULT_LOG_ADDRESS + (place + 1) * FaultRecord.SIZE
        self._eeprom.write(end - len(self._unwritten), self._unwritten[0])
        self._unwritten = self._unwritten[1:]
        if not self._unwritten:
            self._next_number = (self._next_number + 1) % _U16


def is_good(record: FaultRecord) -> bool:
    """Whether the record was written completely."""
    return record.check == _check_of(record)


def _check_of(record: FaultRecord) -> int:
    return crc32(record.pack()[: -_CRC.size])


_ERASED: Final = 0xFF
_ERASED_IMAGE: Final = bytes([_ERASED]) * EEPROM_SIZE


class EepromImage:
    """EEPROM in memory.

    It is erased without ``content``; writing to ``worn_out`` addresses has no effect, so that the
    board must read back.
    """

    def __init__(
        self, content: bytes | None = None, worn_out: frozenset[int] = frozenset()
    ) -> None:
        self.content = bytearray(content or _ERASED_IMAGE)
        self.worn_out = worn_out

    def read(self, address: int, count: int) -> bytes:
        return bytes(self.content[address : address + count])

    def write(self, address: int, value: int) -> None:
        if address not in self.worn_out:
            self.content[address] = value


class EepromFile(EepromImage):
    """EEPROM stored in a file of the same size, so that it outlives the emulator.

    Raises:
        ConfigError: the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        try:
            if not path.exists():
                with replacing(path) as draft:
                    draft.write_bytes(_ERASED_IMAGE)
            self._file = path.open("r+b", buffering=0)
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"EEPROM file {path}: {why(error)}", "give a file that can be written"
            ) from None
        if path.stat().st_size != EEPROM_SIZE:
            self._file.close()
            raise ConfigError(
                f"EEPROM file {path}: not {EEPROM_SIZE} bytes long", "delete it or give another one"
            )
        super().__init__(self._file.read())

    def write(self, address: int, value: int) -> None:
        super().write(address, value)
        self._file.seek(address)
        self._file.write(bytes([value]))

    def close(self) -> None:
        self._file.close()


ConfigGroup = Limits | Slew | Watchdog | Calibration | Equipment | Acceleration

NEVER_SET: Final = (
    ConfigGroups.LIMITS | ConfigGroups.SLEW | ConfigGroups.WATCHDOG | ConfigGroups.CALIBRATION
)
"""Groups that are missing on a new board."""

_GROUPS: Final[tuple[type[ConfigGroup], ...]] = (
    Limits, Slew, Watchdog, Calibration, Equipment, Acceleration,
)  # fmt: skip
"""The groups in their order in the EEPROM."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Six groups; a missing one reads as zeros, which are out of range or inconsistent."""

    limits: Limits
    slew: Slew
    watchdog: Watchdog
    calibration: Calibration
    equipment: Equipment
    acceleration: Acceleration
    missing: ConfigGroups = NEVER_SET

    @classmethod
    def empty(cls, axes: int) -> Self:
        """The configuration of a new board."""
        return cls._of(b"", axes)

    def with_group(self, group: ConfigGroup) -> Configuration:
        """Copy of the configuration with one group replaced."""
        groups: dict[str, Any] = {group.NAME: group}
        found = ConfigGroups.__members__.get(group.NAME.upper(), ConfigGroups(0))
        return replace(self, missing=self.missing & ~found, **groups)

    def pack(self) -> bytes:
        """All groups, in their order in the EEPROM."""
        return b"".join(getattr(self, kind.NAME).pack() for kind in _GROUPS)

    @classmethod
    def unpack(cls, data: bytes, axes: int) -> Self | None:
        """Read the output of :meth:`pack`; None if a value is not allowed.

        Layout 1 lacks equipment and acceleration, which are then zeros.
        """
        read = cls._of(data, axes)
        for group in (getattr(read, kind.NAME) for kind in _GROUPS):
            if group.first_out_of_range() is not None or group.inconsistent_axis() is not None:
                return None
        return replace(read, missing=ConfigGroups(0))

    @classmethod
    def _of(cls, data: bytes, axes: int) -> Self:
        """Read the groups from their bytes, of which missing ones are zeros."""
        groups: dict[str, Any] = {}
        for kind in _GROUPS:
            size = kind.size(axes)
            groups[kind.NAME] = kind.unpack(data[:size].ljust(size, b"\0"), axes)
            data = data[size:]
        return cls(**groups)


_HEADER = struct.Struct("<HBH")
_COUNTER = struct.Struct("<H")
_COUNTER_ERASED = 0xFFFF
_FIRST_GENERATION = 0
_FIRST_LAYOUT = 1


@dataclass(frozen=True, slots=True)
class _Slot:
    address: int
    generation: int
    configuration: Configuration


class _SlotContent(Enum):
    BLANK = auto()
    CORRUPT = auto()


class SaveEnd(Enum):
    """How a save has ended."""

    FINISHED = auto()
    FAILED = auto()


class ConfigStore:
    """Two slots, one of which always holds a complete configuration, and the boot counter.

    Loads the newest configuration; saves to the other slot byte by byte.
    """

    def __init__(self, eeprom: EepromImage, axes: int) -> None:
        self._eeprom = eeprom
        self._slots = (EEPROM_SLOT_A, EEPROM_SLOT_B.of(axes))
        self._image = b""
        self._written = 0
        self._saving: _Slot | None = None
        contents = [_read_slot(eeprom, address, axes) for address in self._slots]
        good = [slot for slot in contents if isinstance(slot, _Slot)]
        self._newest = _newest(good, attrgetter("generation"))
        self.status = _status(contents)

    @property
    def configuration(self) -> Configuration | None:
        """The configuration loaded or last saved."""
        return self._newest.configuration if self._newest else None

    @property
    def busy(self) -> bool:
        return self._saving is not None

    def count_boot(self) -> int:
        """Increment the boot counter and return its new value."""
        stored = self._eeprom.read(EEPROM_BOOT_COUNTER, EEPROM_BOOT_COUNTERS * _COUNTER.size)
        counters = [c for (c,) in _COUNTER.iter_unpack(stored) if c != _COUNTER_ERASED]
        boot_id = ((_newest(counters, int) or 0) + 1) % _COUNTER_ERASED
        address = EEPROM_BOOT_COUNTER + boot_id % EEPROM_BOOT_COUNTERS * _COUNTER.size
        for offset, byte in enumerate(_COUNTER.pack(boot_id), address):
            if self._eeprom.read(offset, 1)[0] != byte:
                self._eeprom.write(offset, byte)
        return boot_id

    def begin_save(self, configuration: Configuration) -> None:
        """Start writing to the older slot."""
        newest = self._newest
        generation = (newest.generation + 1) % _U16 if newest else _FIRST_GENERATION
        slot_a, slot_b = self._slots
        address = slot_b if newest and newest.address == slot_a else slot_a
        body = _HEADER.pack(EEPROM_MAGIC, EEPROM_LAYOUT, generation) + configuration.pack()
        self._image = body + _CRC.pack(crc32(body))
        self._written = 0
        self._saving = _Slot(address, generation, configuration)

    def advance_save(self) -> SaveEnd | None:
        """One tick of a save: verify the byte written in the last tick, write the next one."""
        slot = self._saving
        if slot is None:
            return None
        if self._written > 0 and not self._reads_back(slot.address, self._written - 1):
            self._saving = None
            return SaveEnd.FAILED
        if self._written == len(self._image):
            self._newest, self._saving = slot, None
            return SaveEnd.FINISHED
        self._eeprom.write(slot.address + self._written, self._image[self._written])
        self._written += 1
        return None

    def _reads_back(self, slot_address: int, offset: int) -> bool:
        return self._eeprom.read(slot_address + offset, 1)[0] == self._image[offset]


def _read_slot(eeprom: EepromImage, address: int, axes: int) -> _Slot | _SlotContent:
    content = eeprom.read(address, eeprom_slot_size(axes))
    if content == bytes([_ERASED]) * len(content):
        return _SlotContent.BLANK
    if content[_HEADER.size - 3] == _FIRST_LAYOUT:
        content = content[: -Equipment.SIZE - Acceleration.size(axes)]
    body, stored_crc = content[: -_CRC.size], content[-_CRC.size :]
    magic, layout, generation = _HEADER.unpack_from(body)
    known = magic == EEPROM_MAGIC and layout in (_FIRST_LAYOUT, EEPROM_LAYOUT)
    if not known or _CRC.pack(crc32(body)) != stored_crc:
        return _SlotContent.CORRUPT
    configuration = Configuration.unpack(body[_HEADER.size :], axes)
    if configuration is None:
        return _SlotContent.CORRUPT
    return _Slot(address, generation, configuration)


def _is_newer(number: int, other: int) -> bool:
    return 0 < (number - other) % _U16 < _HALF_U16


def _newest(found: Sequence[T], number: Callable[[T], int]) -> T | None:
    """The first than which no later one is newer, by numbers that wrap; None if there is none."""
    if not found:
        return None
    return reduce(lambda a, b: b if _is_newer(number(b), number(a)) else a, found)


def _status(contents: list[_Slot | _SlotContent]) -> EepromStatus:
    if all(content is _SlotContent.BLANK for content in contents):
        return EepromStatus.BLANK
    any_good = any(isinstance(content, _Slot) for content in contents)
    if _SlotContent.CORRUPT not in contents:
        return EepromStatus.LOADED
    return EepromStatus.ONE_SLOT_BAD if any_good else EepromStatus.BOTH_BAD
