"""The command ``ccr-host emulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands.options import Without
from ccr_host.core.errors import ConfigError
from ccr_host.run.options import RigOptions


def emulate(
    rig: Annotated[RigOptions, Without("device", "tracker", "realtime")],
    tcp: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Serve on TCP; port 0 takes a free one."),
    ] = None,
    pty: Annotated[
        bool, typer.Option("--pty", help="Serve on a pseudo-terminal (the default).")
    ] = False,
    simavr: Annotated[
        bool,
        typer.Option(
            "--simavr", help="The real firmware in simavr, on a pty; an UNO's is flashable."
        ),
    ] = False,
    polaris: Annotated[
        bool,
        typer.Option(
            "--polaris",
            help="Also an emulated Polaris on a pty, which measures the twin moved by the board.",
        ),
    ] = False,
    polaris_tcp: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="The same on TCP.")
    ] = None,
    eeprom: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep the EEPROM in this file.")
    ] = None,
    boot_ms: Annotated[
        int,
        typer.Option(min=0, max=60_000, help="Time of the boot loader after the port is opened."),
    ] = 1000,
) -> None:
    """Serve an emulated board and Polaris in real time. For this or another host.

    The board drives as many servos as the robot has; with --simavr it is an UNO or a Mega 2560.

    Example: ccr-host emulate --tcp 127.0.0.1:5025 --polaris-tcp 127.0.0.1:8765
    """
    from ccr_host.sim.serving.emulate import ServedCamera, open_server

    if tcp is not None and (pty or simavr):
        raise ConfigError("--tcp with --pty or --simavr", "start one emulator for each")
    with_camera = polaris or polaris_tcp is not None
    if polaris and polaris_tcp is not None:
        raise ConfigError("--polaris with --polaris-tcp", "give one of them")
    if simavr and with_camera:
        raise ConfigError("a Polaris with --simavr", "omit --simavr: the board is then emulated")
    description = rig.description()
    tracker_uri = None
    if simavr:
        from ccr_host.sim.simavr.flash_image import board_for, find_firmware
        from ccr_host.sim.simavr.serve import open_pty_server

        name = board_for(description.robot.motors)
        server = open_pty_server(find_firmware(board=name), name, eeprom_file=eeprom)
    else:
        camera = ServedCamera(polaris_tcp, rig.plant, rig.seed) if with_camera else None
        server, tracker_uri = open_server(description, tcp, eeprom, boot_ms * 1000, camera)
    typer.echo(f"emulated board on {server.uri}; Ctrl-C ends it")
    tracking = ""
    if tracker_uri is not None:
        typer.echo(f"emulated Polaris on {tracker_uri}")
        tracking = f" --tracker {tracker_uri}"
    which = f" --robot {rig.robot}" if rig.robot else ""
    typer.echo(f"try: ccr-host track 8shape{which} --device {server.uri}{tracking}")
    server.run_until_signal()
