"""The command ``ccr-host record``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands.options import (
    JsonOption,
    console_beside,
    print_json,
    require_named_tracker,
)
from ccr_host.run.options import RigOptions

_RESTS = 24


def record(
    context: typer.Context,
    rig: RigOptions,
    file: Annotated[
        Path, typer.Argument(metavar="OUT.csv", help="New table of motor angles and tips.")
    ],
    pattern: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="staircase, single, pairs, random, multisine or release; may be repeated. "
            "Default: all.",
        ),
    ] = None,
    rests: Annotated[
        int,
        typer.Option(metavar="N", min=1, max=10_000, help="Rests of random, and of multisine."),
    ] = _RESTS,
    as_json: JsonOption = False,
) -> None:
    """Measure the robot at rest in many poses, for identify. An interruption keeps what there is.

    Example: ccr-host record recorded.csv --robot my-robot.toml --device serial:/dev/ttyACM0
    --tracker ndi:/dev/ttyUSB0
    """
    from collections import Counter

    from ccr_host.commands import terminal
    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig
    from ccr_host.tools.record import new_table, record_rests, stops_of

    require_named_tracker(context, rig)
    description = rig.description()
    stops = stops_of(description, pattern or (), rests, rig.seed)
    screen = console_beside(as_json=as_json)
    with new_table(file, description.robot) as table:
        try:
            with (
                terminal.pose_progress() as on_pose,
                open_rig(rig, description, Observers()) as opened,
            ):
                record_rests(opened, description, stops, table, on_pose)
        finally:
            if table.rests:
                done = f"{table.rests} rests in {len(stops.q_rad)} poses"
                screen.print(f"{done}, saved in {table.settled()}", soft_wrap=True)
    if as_json:
        print_json(
            {
                "file": str(file),
                "robot": description.name,
                "rests": table.rests,
                "poses": dict(Counter(stops.pattern)),
                "device": rig.device,
                "tracker": rig.tracker,
                "seed": rig.seed,
            }
        )
