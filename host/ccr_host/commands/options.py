"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands import completion

PathArgument = Annotated[
    str,
    typer.Argument(
        metavar="PATH",
        help="ellipse, 8shape, star, or a table in a file (t_s,y_mm,z_mm[,x_mm]).",
        autocompletion=completion.paths,
    ),
]
ControllerOption = Annotated[
    str,
    typer.Option(metavar="NAME", help="Controller to use.", autocompletion=completion.controllers),
]
RobotOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Robot description, or the name of a shipped one.",
        autocompletion=completion.robots,
    ),
]
DeviceOption = Annotated[
    str,
    typer.Option(
        metavar="URI", help="emulator:, emulator+pty:, simavr:, serial:PORT or tcp://HOST:PORT."
    ),
]
TrackerOption = Annotated[
    str,
    typer.Option(
        metavar="URI",
        help="twin:, ndi-emulator:, ndi:PORT, ndi+tcp://HOST:PORT, igtl://HOST:PORT, aruco:N "
        "or replay:FILE.",
    ),
]
RateOption = Annotated[float, typer.Option(metavar="HZ", help="Control steps a second.")]
SeedOption = Annotated[int, typer.Option(metavar="N", help="Seed of every random number.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one key of the description; may be repeated."
    ),
]
RealtimeOption = Annotated[bool, typer.Option("--realtime", help="Run in real time.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the results.")]
KeepInOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help="Robot description to keep the result in, made if it is not there; "
        "by default the one of --robot.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the summary alone, as JSON, on standard output.")
]
