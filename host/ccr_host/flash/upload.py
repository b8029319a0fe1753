"""Puts firmware onto a board: PlatformIO builds and uploads it, or avrdude uploads a given file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.simavr.flash_image import read_flash_image

_UPLOAD_TIMEOUT_S = 600
"""The first build may download a tool chain."""
_OPTIBOOT_BAUD = "115200"
_CHECKOUT = Path(__file__).parents[3]
_INSTALL_AVRDUDE: Final = {
    "darwin": "brew install avrdude",
    "win32": "winget install AVRDudes.AVRDUDE",
}
"""By sys.platform; elsewhere with apt."""


def find_project() -> Path | None:
    """Folder of platformio.ini: this one, or the checkout that the host runs from."""
    folders = (Path.cwd(), _CHECKOUT)
    return next((folder for folder in folders if (folder / "platformio.ini").exists()), None)


def upload_project(port: str, project: Path, *, pio: str = "pio") -> None:
    """Build the firmware if need be, and upload it: `pio run -t upload`.

    Args:
        port: of the board.
        project: folder of platformio.ini.
        pio: the program.

    Raises:
        ConfigError: there is no PlatformIO.
        DeviceError: the upload failed.
    """
    program = shutil.which(pio)
    if program is None:
        raise ConfigError(f"{pio} is not installed", "pip install platformio")
    _run([program, "run", "-t", "upload", "--upload-port", port], project, port)


def upload_file(port: str, firmware: Path) -> None:
    """Upload an ELF or HEX file through the boot loader, and read it back.

    Raises:
        ConfigError: it is not a file for an UNO, or there is no avrdude.
        DeviceError: the upload failed.
    """
    read_flash_image(firmware)
    kind = "e" if firmware.suffix == ".elf" else "i"
    _run(
        [
            *_avrdude(),
            *("-q", "-D", "-p", "m328p", "-c", "arduino", "-b", _OPTIBOOT_BAUD),
            *("-P", port, "-U", f"flash:w:{firmware}:{kind}"),
        ],
        Path.cwd(),
        port,
    )


def _avrdude() -> list[str]:
    """The system's avrdude, or PlatformIO's with its configuration file."""
    if program := shutil.which("avrdude"):
        return [program]
    core = Path(os.environ.get("PLATFORMIO_CORE_DIR") or Path.home() / ".platformio")
    package = core / "packages" / "tool-avrdude"
    if program := shutil.which("avrdude", path=f"{package}{os.pathsep}{package / 'bin'}"):
        return [program, "-C", str(package / "avrdude.conf")]
    raise ConfigError(
        "avrdude is not installed", _INSTALL_AVRDUDE.get(sys.platform, "sudo apt install avrdude")
    )


def _run(command: list[str], folder: Path, port: str) -> None:
    """What the program says goes to standard error: standard output is for the summary."""
    cure = "press no button, close other programs on the port, then try again"
    try:
        result = subprocess.run(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=sys.stderr,
            timeout=_UPLOAD_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise DeviceError(f"{port}: no end of the upload", cure) from None
    if result.returncode != 0:
        raise DeviceError(f"{port}: {Path(command[0]).name} failed, see above", cure)
