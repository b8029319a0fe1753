"""The UNO's boot loader, optiboot, for the simulated board."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.simavr.files import cache_folder
from ccr_host.simavr.flash_image import FlashImage, read_flash_image

_FOLDER = Path("bootloaders/optiboot")
_CORES = (
    Path.home() / ".platformio/packages/framework-arduino-avr",
    Path("/usr/share/arduino/hardware/arduino/avr"),
)
"""The Arduino core as PlatformIO and as Debian install it."""
_START = 0x7C00
"""Of a boot section of 1 KB."""
_COMPILE = (
    *("-w", "-Os", "-mmcu=atmega328p", "-DF_CPU=16000000L", "-DBAUD_RATE=115200"),
    *("-DLED_START_FLASHES=3", "-fno-inline-small-functions", "-fno-split-wide-types"),
    *("-mshort-calls", "-nostartfiles", "-nostdlib", "-Wl,--relax"),
    *(f"-Wl,--section-start=.text={_START:#x}", "-Wl,--section-start=.version=0x7ffe"),
)
"""As in optiboot's Makefile but for the start."""


def optiboot() -> FlashImage:
    """Optiboot, built from the source that comes with the Arduino core.

    Debian's binaries are of no use: that of Debian 12 is 20 bytes too long for the 512 bytes of
    boot section for which it is linked, that of Debian 13 is for an ATmega8.

    Raises:
        ConfigError: there is no Arduino core, or no avr-gcc.
    """
    for core in _CORES:
        source = core / _FOLDER / "optiboot.c"
        if source.exists():
            return read_flash_image(_built(source))
    raise ConfigError(
        "simavr: no boot loader", "sudo apt install arduino-core-avr gcc-avr avr-libc"
    )


def _built(source: Path) -> Path:
    elf = cache_folder() / f"optiboot-{_START:04x}.elf"
    if elf.exists() and elf.stat().st_mtime > source.stat().st_mtime:
        return elf
    if shutil.which("avr-gcc") is None:
        raise ConfigError(
            "simavr: no avr-gcc for the boot loader", "sudo apt install gcc-avr avr-libc"
        )
    elf.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=elf.parent) as scratch:
        unfinished = Path(scratch) / elf.name
        result = subprocess.run(
            ["avr-gcc", *_COMPILE, str(source), "-o", str(unfinished)],
            capture_output=True,
            text=True,
            check=False,
        )
        if result.returncode != 0:
            raise DeviceError(
                f"simavr: the boot loader does not build: {result.stderr.strip()}",
                "sudo apt install gcc-avr avr-libc",
            )
        unfinished.replace(elf)
    return elf
