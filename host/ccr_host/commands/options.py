"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands import completion
from ccr_host.commands.output import console
from ccr_host.errors import ConfigError
from ccr_host.run.options import RigOptions

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
SeedOption = Annotated[
    int, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Seed of every random number.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one key of the description; may be repeated."
    ),
]
UncheckedOption = Annotated[
    bool,
    typer.Option(
        "--unchecked", help="Follow the path whatever markers and motion of the robot look like."
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


def warn_of_mismatch(options: RigOptions) -> None:
    """Say so where the board is real and the robot simulated, or the other way round.

    Raises:
        ConfigError: the device or tracker URI is not one.
    """
    from ccr_host.run.rig import mismatch_of

    if mismatch := mismatch_of(options):
        console(on_stderr=True).print(f"note: {mismatch}")


def require_named_tracker(context: typer.Context, options: RigOptions) -> None:
    """Refuse to fit a real board's servos to a simulated robot that nobody has asked for.

    Raises:
        ConfigError: so it would be; or the device or tracker URI is not one.
    """
    from ccr_host.run.rig import sees_simulated_robot

    source = context.get_parameter_source("tracker")
    unnamed = source is not None and source.name == "DEFAULT"
    if unnamed and sees_simulated_robot(options):
        raise ConfigError(
            f"no tracker was named: the board on {options.device} would be fitted to the simulated "
            "robot",
            "name the camera with --tracker; --tracker twin: asks for the simulated one",
        )
