"""Serves a simulated board in real time, so that other programs can use it like a real board."""

from __future__ import annotations

import shutil
from pathlib import Path

from ccr_host.core.clock import LaggingClock
from ccr_host.core.errors import ConfigError
from ccr_host.sim.board.eeprom import EepromFile
from ccr_host.sim.serving.ports import PtyPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.sim.simavr.board import SimavrBoard, SimavrLine
from ccr_host.sim.simavr.flash_image import BoardName, FlashImage, read_flash_image
from ccr_host.sim.simavr.mcu import compiled

_CORES = (
    Path.home() / ".platformio/packages/framework-arduino-avr",
    Path("/usr/share/arduino/hardware/arduino/avr"),
)
"""The Arduino core as installed by PlatformIO and by Debian."""
_COMPILE = (
    *("-w", "-Os", "-mmcu=atmega328p", "-DF_CPU=16000000L", "-DBAUD_RATE=115200"),
    *("-DLED_START_FLASHES=3", "-fno-inline-small-functions", "-fno-split-wide-types"),
    *("-mshort-calls", "-nostartfiles", "-nostdlib", "-Wl,--relax"),
    *("-Wl,--section-start=.text=0x7c00", "-Wl,--section-start=.version=0x7ffe"),
)
"""The flags of optiboot's Makefile, but with the start address of a boot section of 1 KB."""
_CURE = "sudo apt install arduino-core-avr gcc-avr avr-libc"


def optiboot() -> FlashImage:
    """Optiboot, built from the source that comes with the Arduino core.

    Debian's binaries are unusable: that of Debian 12 is 20 bytes too long for the boot section of
    512 bytes for which it is linked, that of Debian 13 is for an ATmega8.

    Raises:
        ConfigError: the Arduino core or avr-gcc is missing.
        DeviceError: it does not compile.
    """
    sources = (core / "bootloaders/optiboot/optiboot.c" for core in _CORES)
    source = next((file for file in sources if file.exists()), None)
    if source is None:
        raise ConfigError("simavr: no boot loader", _CURE)
    return read_flash_image(compiled("optiboot.elf", _avr_gcc, [source], _COMPILE, _CURE))


def _avr_gcc() -> str:
    if shutil.which("avr-gcc") is None:
        raise ConfigError("simavr: no avr-gcc for the boot loader", _CURE)
    return "avr-gcc"


_IDLE_SKETCH = FlashImage(((0, bytes.fromhex("81e0 83bf 8895 fecf")),))
"""ldi r24, 1; out SMCR, r24; sleep; rjmp .-4. Erased flash would be executed up to the boot loader
and enter it in the middle."""
_GET_SYNC = b"0 "
"""Sent by avrdude after each DTR pulse, which resets an UNO."""
_AVRDUDE_WAITS_US = 50_000
"""Time from the pulse to this command, so that the boot loader is ready for it."""
_BOOT_LOADER_WAITS_US = 1_000_000


class FlashableLine(SimavrLine):
    """A line on which avrdude's sync command resets the board, as a pseudo-terminal has no DTR.

    The reset on opening the port is not enough: if avrdude missed the boot loader after it, none of
    its retries would find it.
    """

    _reset_us = 0

    def open_port(self, boot_loader_us: int = 0) -> None:
        super().open_port(boot_loader_us)
        self._reset_us = self.board.now_us

    def write(self, data: bytes) -> None:
        """Start to transmit bytes now; a sync command outside the boot loader resets the board."""
        is_sync = data and not data.replace(_GET_SYNC, b"")
        if is_sync and self.board.now_us - self._reset_us > _BOOT_LOADER_WAITS_US:
            self.open_port()
            self.advance_to(self._reset_us + _AVRDUDE_WAITS_US)
            data = _GET_SYNC
        super().write(data)


def open_pty_server(
    firmware: Path | None,
    board_name: BoardName = "uno",
    *,
    eeprom_file: Path | None = None,
    boot_loader: bool = True,
) -> BoardServer:
    """Create a board on a pseudo-terminal; opening the terminal resets the board.

    Without ``firmware`` an UNO has to be flashed first; without ``eeprom_file`` the EEPROM is
    erased each time. With ``boot_loader`` optiboot is in the flash of an UNO, so that avrdude can
    upload; it waits a second for an upload after each reset. A Mega is simulated without one.

    Raises:
        ConfigError: a file cannot be used.
        DeviceError: the simulator is not available.
    """
    image = read_flash_image(firmware, board_name) if firmware else _IDLE_SKETCH
    boot_loader = boot_loader and image.board == "uno"
    board = SimavrBoard(
        image,
        boot_loader=optiboot() if boot_loader else None,
        eeprom=EepromFile(eeprom_file) if eeprom_file else None,
    )
    line = (FlashableLine if boot_loader else SimavrLine)(board, baud=None)
    return BoardServer(line, PtyPort(), LaggingClock(), boot_loader_us=0)
