"""The last faults, in a ring of records in EEPROM (LOG-1)."""

from __future__ import annotations

from binascii import crc32
from dataclasses import replace

from ccr_host.emulator.eeprom import Eeprom
from ccr_host.link.messages import FAULT_LOG_ADDRESS, FAULT_LOG_RECORDS, FaultRecord

_CHECK_BYTES = 4
_U16 = 1 << 16
_HALF_U16 = 1 << 15


class FaultLog:
    """Finds the newest record; writes the next byte by byte."""

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
        """What stands there, good or not."""
        address = FAULT_LOG_ADDRESS + place * FaultRecord.SIZE
        return FaultRecord.unpack(self._eeprom.read(address, FaultRecord.SIZE))

    @property
    def is_writing(self) -> bool:
        """Whether a record is being written."""
        return bool(self._unwritten)

    def begin(self, record: FaultRecord) -> None:
        """Start to write; number and check are given to it."""
        record = replace(record, number=self._next_number)
        self._unwritten = replace(record, check=_check_of(record)).pack()

    def advance(self) -> None:
        """Write one byte."""
        if not self._unwritten:
            return
        place = self._next_number % FAULT_LOG_RECORDS
        end = FAULT_LOG_ADDRESS + (place + 1) * FaultRecord.SIZE
        self._eeprom.write(end - len(self._unwritten), self._unwritten[0])
        self._unwritten = self._unwritten[1:]
        if not self._unwritten:
            self._next_number = (self._next_number + 1) % _U16


def is_good(record: FaultRecord) -> bool:
    """Whether it was written to its end."""
    return record.check == _check_of(record)


def _check_of(record: FaultRecord) -> int:
    return crc32(record.pack()[:-_CHECK_BYTES])
