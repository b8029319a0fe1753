"""The board under test, seen from outside only: bytes, time, pins, reset, EEPROM."""

from __future__ import annotations

from typing import Protocol

from ccr_host.emulator.board import UnoEmulator
from ccr_host.emulator.eeprom import EepromImage
from ccr_host.emulator.serial_line import SerialLine
from ccr_host.link import messages as m


class Device(Protocol):
    """A board and its wire."""

    eeprom: EepromImage

    def send(self, data: bytes) -> None: ...
    def advance_to(self, since_reset_us: int) -> None: ...
    def since_reset_us(self) -> int: ...
    def read(self) -> bytes: ...
    def pulses_half_us(self) -> tuple[int, int]: ...
    def reset(self, cause: m.ResetCause) -> None: ...
    def inject_fault(self, fault: m.Fault) -> None: ...
    def close(self) -> None: ...


class EmulatedDevice:
    """The emulator as a device."""

    def __init__(self, eeprom: EepromImage, **board_options: int) -> None:
        self.eeprom = eeprom
        self._board = UnoEmulator(eeprom, **board_options)
        self._line = SerialLine(self._board)
        self._reset_us = 0

    def send(self, data: bytes) -> None:
        self._line.write(data)

    def advance_to(self, since_reset_us: int) -> None:
        self._line.advance_to(self._reset_us + since_reset_us)

    def since_reset_us(self) -> int:
        return self._board.now_us - self._reset_us

    def read(self) -> bytes:
        return self._line.read()

    def pulses_half_us(self) -> tuple[int, int]:
        return self._board.pulses_half_us

    def reset(self, cause: m.ResetCause) -> None:
        self._board.reset(cause)
        self._reset_us = self._board.now_us

    def inject_fault(self, fault: m.Fault) -> None:
        self._board.inject_fault(fault)

    def close(self) -> None:
        pass


def make_device(uri: str, eeprom: EepromImage, **start_values: int) -> Device:
    """A board that has just been started.

    Args:
        uri: `emulator:`.
        eeprom: what it starts with, and writes to.
        start_values: `board_time_at_reset_us`, `tick_offset`: what its clocks show at a reset.
    """
    if uri == "emulator:":
        return EmulatedDevice(eeprom, **start_values)
    raise ValueError(f"no such device for the conformance suite: {uri}")
