"""`ccr-host flash`: upload the firmware to a board and check that it answers."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple, Protocol

import numpy as np
from serial.tools import list_ports

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.link.board import drawn_session
from ccr_host.link.client import Client
from ccr_host.link.messages import HelloReply
from ccr_host.link.transport import open_transport, parse_device_uri
from ccr_host.sim.simavr.flash_image import BoardName, read_flash_image, released_firmware


class _Kind(NamedTuple):
    """What flashing a kind of board takes."""

    shown: str
    usb: frozenset[tuple[int, int]]
    """USB vendor and product ids, from boards.txt of the Arduino core."""
    avrdude: tuple[str, ...]
    """Chip and protocol of its boot loader."""


_KINDS: Final[dict[BoardName, _Kind]] = {
    "uno": _Kind(
        "UNO",
        frozenset(
            {(0x2341, 0x0043), (0x2341, 0x0001), (0x2A03, 0x0043), (0x2341, 0x0243)}
            | {(0x2341, 0x006A)}
        ),
        ("-p", "m328p", "-c", "arduino"),
    ),
    "mega2560": _Kind(
        "Mega 2560",
        frozenset(
            {(0x2341, 0x0010), (0x2341, 0x0042), (0x2A03, 0x0010), (0x2A03, 0x0042)}
            | {(0x2341, 0x0210), (0x2341, 0x0242)}
        ),
        ("-p", "m2560", "-c", "wiring"),
    ),
}
_BRIDGE: Final = frozenset({(0x1A86, 0x7523), (0x0403, 0x6001), (0x10C4, 0xEA60)})
"""USB-to-serial chips of compatible boards and many other devices: CH340, FT232R, CP2102."""


class PortInfo(Protocol):
    """The attributes of pyserial's port information that are used here."""

    device: str
    vid: int | None
    pid: int | None


def choose_port(
    given: str | None, ports: Iterable[PortInfo] | None = None, board: BoardName = "uno"
) -> str:
    """The given port, or the only one that can be the board.

    A ``given`` port need not be USB; without one, ``ports`` are searched, by default those of this
    machine.

    Raises:
        ConfigError: several ports match.
        DeviceError: no port matches, or it cannot be opened.
    """
    if given is None:
        given = _only_candidate(_KINDS[board], list_ports.comports() if ports is None else ports)
    open_transport(parse_device_uri(f"serial:{given}")).close()
    return given


def _only_candidate(kind: _Kind, ports: Iterable[PortInfo]) -> str:
    known = list(ports)
    for ids in (kind.usb, _BRIDGE):
        fitting = [port.device for port in known if (port.vid, port.pid) in ids]
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise ConfigError(
                f"several boards: {', '.join(sorted(fitting))}", "name one with --port"
            )
    raise DeviceError(
        f"no {kind.shown} found among the USB ports", "plug it in, or name its port with --port"
    )


_UPLOAD_TIMEOUT_S = 600
"""The first build may download a tool chain."""
_BOOT_LOADER_BAUD = "115200"
_CHECKOUT = Path(__file__).parents[3]
_INSTALL_AVRDUDE: Final = {
    "darwin": "brew install avrdude",
    "win32": "winget install AVRDudes.AVRDUDE",
}
"""Install command by sys.platform; apt elsewhere."""


def find_project() -> Path | None:
    """Folder of platformio.ini: the current one, or the checkout that the host runs from."""
    folders = (Path.cwd(), _CHECKOUT)
    return next((folder for folder in folders if (folder / "platformio.ini").exists()), None)


def upload_project(port: str, project: Path, board: BoardName = "uno", *, pio: str = "pio") -> None:
    """Build the firmware if necessary and upload it: `pio run -t upload`.

    ``project`` is the folder of platformio.ini, ``pio`` PlatformIO's program.

    Raises:
        ConfigError: PlatformIO is not installed.
        DeviceError: the upload failed.
    """
    program = shutil.which(pio)
    if program is None:
        raise ConfigError(f"{pio} is not installed", "pip install platformio")
    _run([program, "run", "-e", board, "-t", "upload", "--upload-port", port], project, port)


def upload_file(port: str, firmware: Path, board: BoardName = "uno") -> None:
    """Upload an ELF or HEX file through the boot loader and verify it.

    Raises:
        ConfigError: not a file for the board, or avrdude is not installed.
        DeviceError: the upload failed.
    """
    built_for = read_flash_image(firmware, board).board
    if built_for != board:
        raise ConfigError(
            f"firmware {firmware}: built for the {_KINDS[built_for].shown}",
            f"give --board {built_for}, or a file for the {_KINDS[board].shown}",
        )
    kind = "e" if firmware.suffix == ".elf" else "i"
    _run(
        [
            *_avrdude(),
            *("-q", "-D", *_KINDS[board].avrdude, "-b", _BOOT_LOADER_BAUD),
            *("-P", port, "-U", f"flash:w:{firmware}:{kind}"),
        ],
        Path.cwd(),
        port,
    )


def _avrdude() -> list[str]:
    """Command of the system's avrdude, or of PlatformIO's with its configuration file."""
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
    """Run a program with its output on standard error; standard output is for the summary."""
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
        raise DeviceError(f"{port}: the upload timed out", cure) from None
    if result.returncode != 0:
        raise DeviceError(f"{port}: {Path(command[0]).name} failed, see above", cure)


def flash_board(
    port: str | None = None,
    firmware: Path | None = None,
    board: BoardName = "uno",
    *,
    project: Path | None = None,
    pio: str = "pio",
) -> tuple[str, HelloReply]:
    """Find the board, upload the firmware; return the port, and the identity of what is there now.

    ``firmware`` is a HEX or ELF file for avrdude; None builds the project with PlatformIO or, if
    there is no project, takes the file that came with this installation. ``project`` is the folder
    of platformio.ini, by default the current one or the host's checkout.

    Raises:
        ConfigError: a program is missing on this machine, or there are several boards.
        DeviceError: no board, the upload failed, or the board does not answer.
        SpecMismatchError: the board was built from another spec than this host.
    """
    chosen = choose_port(port, board=board)
    project = project or find_project()
    if firmware is not None or project is None:
        upload_file(chosen, firmware or released_firmware(board), board)
    else:
        upload_project(chosen, project, board, pio=pio)
    return chosen, say_hello(chosen)


def say_hello(port: str) -> HelloReply:
    """Open the port, which resets the board, and query its identity until it answers.

    Raises:
        DeviceError: the board does not answer.
    """
    clock = RealClock()
    transport = open_transport(parse_device_uri(f"serial:{port}"))
    with Client(transport, clock, drawn_session(np.random.default_rng())) as client:
        return client.connect(telemetry_period_ticks=0)
