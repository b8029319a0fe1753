"""Two EEPROM slots, one of which always holds a complete configuration, and the boot counter."""

from __future__ import annotations

import struct
from binascii import crc32
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, Final, Self

from ccr_host.link.messages import (
    EEPROM_BOOT_COUNTER,
    EEPROM_BOOT_COUNTERS,
    EEPROM_LAYOUT,
    EEPROM_MAGIC,
    EEPROM_SLOT_A,
    EEPROM_SLOT_B,
    Acceleration,
    Calibration,
    ConfigGroups,
    EepromStatus,
    Equipment,
    Limits,
    Slew,
    Watchdog,
    eeprom_slot_size,
)
from ccr_host.sim.board.eeprom import ERASED, Eeprom

ConfigGroup = Limits | Slew | Watchdog | Calibration | Equipment | Acceleration

NEVER_SET: Final = (
    ConfigGroups.LIMITS | ConfigGroups.SLEW | ConfigGroups.WATCHDOG | ConfigGroups.CALIBRATION
)
"""Groups that are missing on a new board."""

_GROUPS: Final[tuple[type[ConfigGroup], ...]] = (
    *(Limits, Slew, Watchdog, Calibration),
    *(Equipment, Acceleration),
)
"""In their order in the EEPROM."""


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
_CRC = struct.Struct("<I")
_COUNTER = struct.Struct("<H")
_COUNTER_ERASED = 0xFFFF
_U16 = 1 << 16
_HALF_U16 = 1 << 15
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


class SaveStep(Enum):
    """Result of writing one byte."""

    IDLE = auto()
    WRITING = auto()
    FINISHED = auto()
    FAILED = auto()


class ConfigStore:
    """Loads the newest complete configuration; saves to the other slot byte by byte."""

    def __init__(self, eeprom: Eeprom, axes: int) -> None:
        self._eeprom = eeprom
        self._slots = (EEPROM_SLOT_A, EEPROM_SLOT_B.of(axes))
        self._image = b""
        self._written = 0
        self._saving: _Slot | None = None
        contents = [_read_slot(eeprom, address, axes) for address in self._slots]
        self._newest = _newest([slot for slot in contents if isinstance(slot, _Slot)])
        self.status = _status(contents)

    @property
    def configuration(self) -> Configuration | None:
        """The configuration loaded or last saved."""
        return self._newest.configuration if self._newest else None

    @property
    def busy(self) -> bool:
        """Whether a save is being written."""
        return self._saving is not None

    def count_boot(self) -> int:
        """Increment the boot counter and return its new value."""
        stored = self._eeprom.read(EEPROM_BOOT_COUNTER, EEPROM_BOOT_COUNTERS * _COUNTER.size)
        newest = 0
        counters = [c for (c,) in _COUNTER.iter_unpack(stored) if c != _COUNTER_ERASED]
        for number, counter in enumerate(counters):
            if number == 0 or _is_newer(counter, newest):
                newest = counter
        boot_id = (newest + 1) % _COUNTER_ERASED
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

    def advance_save(self) -> SaveStep:
        """One tick of a save: verify the byte written in the last tick, write the next one."""
        slot = self._saving
        if slot is None:
            return SaveStep.IDLE
        if self._written > 0 and not self._reads_back(slot.address, self._written - 1):
            self._saving = None
            return SaveStep.FAILED
        if self._written == len(self._image):
            self._newest, self._saving = slot, None
            return SaveStep.FINISHED
        self._eeprom.write(slot.address + self._written, self._image[self._written])
        self._written += 1
        return SaveStep.WRITING

    def _reads_back(self, slot_address: int, offset: int) -> bool:
        return self._eeprom.read(slot_address + offset, 1)[0] == self._image[offset]


def _read_slot(eeprom: Eeprom, address: int, axes: int) -> _Slot | _SlotContent:
    content = eeprom.read(address, eeprom_slot_size(axes))
    if content == bytes([ERASED]) * len(content):
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


def _newest(good: list[_Slot]) -> _Slot | None:
    newest = good[0] if good else None
    for slot in good[1:]:
        newest = slot if _is_newer(slot.generation, good[0].generation) else good[0]
    return newest


def _is_newer(number: int, other: int) -> bool:
    return 0 < (number - other) % _U16 < _HALF_U16


def _status(contents: list[_Slot | _SlotContent]) -> EepromStatus:
    if all(content is _SlotContent.BLANK for content in contents):
        return EepromStatus.BLANK
    any_good = any(isinstance(content, _Slot) for content in contents)
    if _SlotContent.CORRUPT not in contents:
        return EepromStatus.LOADED
    return EepromStatus.ONE_SLOT_BAD if any_good else EepromStatus.BOTH_BAD
