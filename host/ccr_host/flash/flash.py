"""`ccr-host flash`: from an UNO on a cable to a board that answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccr_host.flash.ports import choose_port
from ccr_host.flash.upload import find_project, upload_file, upload_project
from ccr_host.link.client import Client, drawn_session
from ccr_host.link.messages import HelloReply
from ccr_host.link.transport import open_transport
from ccr_host.link.uri import parse_device_uri
from ccr_host.run.clock import RealClock
from ccr_host.simavr.files import RELEASED_FIRMWARE


@dataclass(frozen=True)
class FlashReport:
    """What is now on the board."""

    port: str
    identity: HelloReply

    @property
    def firmware_version(self) -> str:
        """As in the board's answer."""
        return ".".join(map(str, self.identity.firmware_version))

    def summary(self) -> dict[str, object]:
        """For `--json`."""
        return {
            "port": self.port,
            "firmware_version": self.firmware_version,
            "protocol_version": self.identity.protocol_version,
            "spec_hash": f"{self.identity.spec_hash:08x}",
            "eeprom_status": self.identity.eeprom_status.name.lower(),
        }


def flash_board(
    port: str | None = None,
    firmware: Path | None = None,
    *,
    project: Path | None = None,
    pio: str = "pio",
) -> FlashReport:
    """Find the board, upload, and let it say hello.

    Args:
        port: of the board; None to look for it.
        firmware: HEX or ELF file for avrdude; None to build the project with PlatformIO, or where
            there is none to take the file that came with this installation.
        project: folder of platformio.ini; None for this folder or the checkout of the host.
        pio: PlatformIO's program.

    Raises:
        ConfigError: something is missing on this machine, or several boards are there.
        DeviceError: no board, upload failed, or the board does not answer.
        SpecMismatchError: it answers, but was built from another spec than this host.
    """
    chosen = choose_port(port)
    project = project or find_project()
    if firmware is not None or project is None:
        upload_file(chosen, firmware or RELEASED_FIRMWARE)
    else:
        upload_project(chosen, project, pio=pio)
    return FlashReport(chosen, say_hello(chosen))


def say_hello(port: str) -> HelloReply:
    """Open the port, which resets the board, and ask until it answers.

    Raises:
        DeviceError: it does not.
    """
    clock = RealClock()
    transport = open_transport(parse_device_uri(f"serial:{port}"))
    with Client(transport, clock, drawn_session(np.random.default_rng())) as client:
        return client.connect(telemetry_period_ticks=0)
