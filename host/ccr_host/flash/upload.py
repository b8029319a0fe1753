"""Puts firmware onto a board: PlatformIO builds and uploads it, or avrdude uploads a given file."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.simavr.flash_image import read_flash_image

_UPLOAD_TIMEOUT_S = 600
"""The first build may download a tool chain."""
_OPTIBOOT_BAUD = "115200"
_CHECKOUT = Path(__file__).parents[3]


def upload_project(port: str, *, project: Path | None = None, pio: str = "pio") -> None:
    """Build the firmware if need be, and upload it: `pio run -t upload`.

    Args:
        port: of the board.
        project: folder of platformio.ini; None for this folder or the checkout of the host.
        pio: the program.

    Raises:
        ConfigError: there is no project, or no PlatformIO.
        DeviceError: the upload failed.
    """
    folder = _project_folder(project)
    _run(
        [_program(pio, "pip install platformio"), "run", "-t", "upload", "--upload-port", port],
        folder,
        port,
    )


def upload_file(port: str, firmware: Path) -> None:
    """Upload a HEX file through the boot loader, and read it back.

    Raises:
        ConfigError: it is not a HEX file for an UNO, or there is no avrdude.
        DeviceError: the upload failed.
    """
    read_flash_image(firmware)
    kind = "e" if firmware.suffix == ".elf" else "i"
    avrdude = _program("avrdude", "sudo apt install avrdude")
    _run(
        [
            *(avrdude, "-q", "-D", "-p", "m328p", "-c", "arduino", "-b", _OPTIBOOT_BAUD),
            *("-P", port, "-U", f"flash:w:{firmware}:{kind}"),
        ],
        Path.cwd(),
        port,
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


def _program(name: str, cure: str) -> str:
    path = shutil.which(name)
    if path is None:
        raise ConfigError(f"{name} is not installed", cure)
    return path


def _project_folder(given: Path | None) -> Path:
    for folder in [given] if given else [Path.cwd(), _CHECKOUT]:
        if (folder / "platformio.ini").exists():
            return folder
    raise ConfigError(
        f"no platformio.ini in {given or Path.cwd()}",
        "run it in a checkout of the project, or give a HEX file",
    )
