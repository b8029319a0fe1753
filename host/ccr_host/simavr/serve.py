"""Serves a simulated UNO in real time, so that other programs find it like a board on a cable."""

from __future__ import annotations

from pathlib import Path

from ccr_host.emulator.eeprom import EepromFile
from ccr_host.emulator.pty_port import PtyPort
from ccr_host.emulator.server import BoardServer
from ccr_host.run.clock import LaggingClock
from ccr_host.simavr.board import SimavrBoard
from ccr_host.simavr.boot_loader import optiboot
from ccr_host.simavr.flash_image import FlashImage, read_flash_image
from ccr_host.simavr.line import SimavrLine

_IDLE_SKETCH = FlashImage(((0, bytes.fromhex("81e0 83bf 8895 fecf")),))
"""ldi r24, 1; out SMCR, r24; sleep; rjmp .-4: erased flash would be run through, into the middle of
the boot loader."""
_GET_SYNC = b"0 "
"""What avrdude says after each pulse on DTR, which makes an UNO reset."""
_AVRDUDE_WAITS_US = 50_000
"""From the pulse to the call, so that the boot loader is ready for it."""
_BOOT_LOADER_WAITS_US = 1_000_000


class FlashableLine(SimavrLine):
    """Avrdude's call for the boot loader resets the board: a pseudo-terminal has no DTR.

    The reset on opening the port is not enough: if avrdude comes too late after it, none of its
    further attempts would find the boot loader.
    """

    _reset_us = 0

    def open_port(self, boot_loader_us: int = 0) -> None:
        """Reset the board as an UNO is reset (DTR) when its port is opened."""
        super().open_port(boot_loader_us)
        self._reset_us = self.board.now_us

    def write(self, data: bytes) -> None:
        """Put bytes on the wire now."""
        is_call = data and not data.replace(_GET_SYNC, b"")
        if is_call and self.board.now_us - self._reset_us > _BOOT_LOADER_WAITS_US:
            self.open_port()
            self.advance_to(self._reset_us + _AVRDUDE_WAITS_US)
            data = _GET_SYNC
        super().write(data)


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
    line = (FlashableLine if boot_loader else SimavrLine)(board, baud=None)
    return BoardServer(line, PtyPort(), LaggingClock(), boot_loader_us=0)
