"""The EEPROM as bytes, in memory or in a file, and the fault log."""

from __future__ import annotations

from binascii import crc32
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import replacing
from ccr_host.link.messages import EEPROM_SIZE, FAULT_LOG_ADDRESS, FAULT_LOG_RECORDS, FaultRecord

_CHECK_BYTES = 4
_U16 = 1 << 16
_HALF_U16 = 1 << 15


class FaultLog:
    """The fault records: finds the newest one, writes the next byte by byte."""

    def __init__(self, eeprom: Eeprom) -> None:
        self._eeprom = eeprom
        self._unwritten = b""
        good = [
            record.number
            for place in range(FAULT_LOG_RECORDS)
            if is_good(record := self.at(place)) and record.number % FAULT_LOG_RECORDS == place
        ]
        newest = next(
            (n for n in good if all((n - other) % _U16 < _HALF_U16 for other in good)), None
        )
        self._next_number = 0 if newest is None else (newest + 1) % _U16

    def at(self, place: int) -> FaultRecord:
        """The record at this place, valid or not."""
        address = FAULT_LOG_ADDRESS + place * FaultRecord.SIZE
        return FaultRecord.unpack(self._eeprom.read(address, FaultRecord.SIZE))

    @property
    def is_writing(self) -> bool:
        """Whether a record is being written."""
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
    return crc32(record.pack()[:-_CHECK_BYTES])


ERASED: Final = 0xFF


class Eeprom(Protocol):
    """The EEPROM as seen by the board."""

    def read(self, address: int, count: int) -> bytes:
        """Read `count` bytes from `address` on."""

    def write(self, address: int, value: int) -> None:
        """Write one byte; it may fail, so the caller must read back."""


class EepromImage:
    """EEPROM in memory.

    Args:
        content: initial bytes; erased if omitted.
        worn_out: addresses at which writing has no effect.
    """

    def __init__(
        self, content: bytes | None = None, worn_out: frozenset[int] = frozenset()
    ) -> None:
        self.content = bytearray(content or bytes([ERASED]) * EEPROM_SIZE)
        self.worn_out = worn_out

    def read(self, address: int, count: int) -> bytes:
        return bytes(self.content[address : address + count])

    def write(self, address: int, value: int) -> None:
        if address not in self.worn_out:
            self.content[address] = value


class EepromFile:
    """EEPROM stored in a file of the same size, so that it outlives the emulator.

    Raises:
        ConfigError: the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        try:
            if not path.exists():
                with replacing(path) as draft:
                    draft.write_bytes(bytes([ERASED]) * EEPROM_SIZE)
            self._file = path.open("r+b", buffering=0)
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise ConfigError(
                f"EEPROM file {path}: {why}", "give a file that can be written"
            ) from None
        if path.stat().st_size != EEPROM_SIZE:
            self._file.close()
            raise ConfigError(
                f"EEPROM file {path}: not {EEPROM_SIZE} bytes long", "delete it or give another one"
            )

    def read(self, address: int, count: int) -> bytes:
        self._file.seek(address)
        return self._file.read(count)

    def write(self, address: int, value: int) -> None:
        self._file.seek(address)
        self._file.write(bytes([value]))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
