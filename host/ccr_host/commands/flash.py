"""The command ``ccr-host flash``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands.options import JsonOption, console_beside, print_json
from ccr_host.sim.simavr.flash_image import BoardName


def flash(
    firmware: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]",
            help="HEX or ELF file; by default the checkout is built, or the shipped file used.",
        ),
    ] = None,
    board: Annotated[BoardName, typer.Option(help="The kind of board.")] = "uno",
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="Serial port; needed if there are several.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Upload the firmware to a board and check that it answers.

    Example: ccr-host flash --port /dev/ttyACM0
    """
    from ccr_host.link.device_errors import firmware_version
    from ccr_host.tools.flash import flash_board

    found, identity = flash_board(port, firmware, board)
    version, eeprom = firmware_version(identity), identity.eeprom_status.name.lower()
    screen = console_beside(as_json=as_json)
    screen.print(
        f"{found}: firmware {version} answers, boot {identity.boot_id}, EEPROM {eeprom}",
    )
    if as_json:
        print_json(
            {
                "port": found,
                "firmware_version": version,
                "protocol_version": identity.protocol_version,
                "spec_hash": f"{identity.spec_hash:08x}",
                "eeprom_status": eeprom,
            }
        )
