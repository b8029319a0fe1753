"""The command ``ccr-host register``."""

from __future__ import annotations

import typer

from ccr_host.commands.options import (
    JsonOption,
    KeepInOption,
    console,
    print_json,
    require_named_tracker,
)
from ccr_host.run.options import RigOptions


def register(
    context: typer.Context,
    rig: RigOptions,
    out: KeepInOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the camera's orientation in a tour of the robot. Saved in the file.

    Example: ccr-host register --robot my-robot.toml --device serial:/dev/ttyACM0
    --tracker ndi:/dev/ttyUSB0
    """
    import datetime
    import math

    from ccr_host.commands import terminal
    from ccr_host.commands.tracker_screen import registration_table
    from ccr_host.description.file import file_to_keep_in, keep_in
    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig
    from ccr_host.tools.survey import REGISTRATION, registration_section, sections_of, survey

    require_named_tracker(context, rig)
    description = rig.description()
    file = file_to_keep_in(rig.robot, out)
    screen = console(on_stderr=as_json)
    with (
        terminal.steps_progress(console(on_stderr=True), "poses") as on_pose,
        open_rig(rig, description, Observers(), in_camera_frame=True) as opened,
    ):
        found = survey(opened, description, on_pose)
    today = datetime.date.today()
    section = registration_section(found, description, today)
    kept = {REGISTRATION: section}
    if found.servos_are_as_described:
        kept = sections_of(found, description, description.servo, today)
    screen.print(registration_table(found))
    if file is None:
        screen.print("not saved: give your robot description, or --out FILE")
    else:
        keep_in(file, kept, rig.robot)
        screen.print(f"saved in {file}, as section {' and '.join(kept)}")
    if as_json:
        print_json(
            {
                **section,
                "date": section["date"].isoformat(),
                "segment_1_mm": float(found.lengths_mm[0]),
                "hysteresis_mm": [
                    None if math.isnan(half_mm) else round(float(half_mm), 2)
                    for half_mm in found.hysteresis_mm
                ],
                "reversed_motors": list(found.reversed_motors),
                "device": rig.device,
                "tracker": rig.tracker,
                "seed": rig.seed,
                "kept_in": None if file is None else str(file),
            }
        )
