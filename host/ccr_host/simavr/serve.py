"""Serves a simulated UNO in real time, so that other programs find it like a board on a cable."""

from __future__ import annotations

from pathlib import Path

from ccr_host.emulator.eeprom import EepromFile
from ccr_host.emulator.pty_port import PtyPort
from ccr_host.emulator.server import BoardServer
from ccr_host.run.clock import RealClock
from ccr_host.simavr.board import SimavrBoard
from ccr_host.simavr.boot_loader import optiboot
from ccr_host.simavr.flash_image import FlashImage, read_flash_image
from ccr_host.simavr.line import SimavrLine

_IDLE_SKETCH = FlashImage(((0, b"\xff\xcf"),))
"""`rjmp .-2`: erased flash would be run through, into the middle of the boot loader."""


def open_pty_server(
    firmware: Path | None, *, eeprom_file: Path | None = None, boot_loader: bool = True
) -> BoardServer:
    """Make a board on a pseudo-terminal, ready to run; opening that resets it.

    Args:
        firmware: in the flash at the start; None for an UNO that has to be flashed first.
        eeprom_file: kept across runs; None for an erased EEPROM each time.
        boot_loader: optiboot is in the flash, so that avrdude can upload; it waits for that for a
            second after each reset.

    Raises:
        ConfigError: a file cannot be used.
        DeviceError: the simulator is not there.
    """
    board = SimavrBoard(
        read_flash_image(firmware) if firmware else _IDLE_SKETCH,
        boot_loader=optiboot() if boot_loader else None,
        eeprom=EepromFile(eeprom_file) if eeprom_file else None,
    )
    line = SimavrLine(board, baud=None)
    return BoardServer(line, PtyPort(), RealClock(), boot_loader_us=0)
