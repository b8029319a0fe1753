"""The command ``ccr-host emulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.errors import ConfigError


def emulate(
    tcp: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Serve on TCP; port 0 takes a free one."),
    ] = None,
    pty: Annotated[
        bool, typer.Option("--pty", help="Serve on a pseudo-terminal (the default).")
    ] = False,
    simavr: Annotated[
        bool,
        typer.Option("--simavr", help="The real firmware in simavr, on a pty, flashable."),
    ] = False,
    eeprom: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep the EEPROM in this file.")
    ] = None,
    boot_ms: Annotated[
        int, typer.Option(min=0, help="How long the boot loader is deaf after the port is opened.")
    ] = 1000,
) -> None:
    """Serve the emulated board in real time, for this host or for your own.

    Example: ccr-host emulate --tcp 127.0.0.1:5025
    """
    from ccr_host.emulator.serve import open_server

    if tcp is not None and (pty or simavr):
        raise ConfigError("--tcp with --pty or --simavr", "start one board for each")
    if simavr:
        from ccr_host.simavr.files import find_firmware
        from ccr_host.simavr.serve import open_pty_server

        server = open_pty_server(find_firmware(), eeprom_file=eeprom)
    else:
        server = open_server(tcp, eeprom, boot_loader_us=boot_ms * 1000)
    typer.echo(f"emulated board on {server.uri}; Ctrl-C ends it")
    typer.echo(f"try: ccr-host track 8shape --device {server.uri}")
    server.run_until_signal()
