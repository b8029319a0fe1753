"""The command ``ccr-host register``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import typer
from rich.table import Table

from ccr_host.commands.options import (
    JsonOption,
    KeepInOption,
    console_beside,
    print_json,
    require_named_tracker,
)
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from ccr_host.tools.survey_fit import Survey


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
    from ccr_host.description.file import file_to_keep_in, keep_in
    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig
    from ccr_host.tools.survey import REGISTRATION, registration_section, sections_of, survey

    require_named_tracker(context, rig)
    description = rig.description()
    file = file_to_keep_in(rig.robot, out)
    screen = console_beside(as_json=as_json)
    with (
        terminal.pose_progress() as on_pose,
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


def registration_table(found: Survey) -> Table:
    """The camera's orientation and its uncertainty."""
    table = Table(title="registration", title_justify="left", show_header=False)
    turned, uncertain = found.camera_to_robot_deg, found.uncertainty_deg
    table.add_row("camera to robot, rotation vector (deg)", _numbers(turned, 2))
    table.add_row("uncertainty about x, y, z (deg)", _numbers(uncertain, 2))
    table.add_row("residual (mm)", f"{found.residual_mm:.2f}")
    motors = ", ".join(str(motor + 1) for motor in range(len(found.direction)))
    tip = f"M{len(found.lengths_mm) + 1}"
    hysteresis = _numbers(found.hysteresis_mm, 2)
    table.add_row(f"hysteresis of {tip} by motor {motors} (+- mm)", hysteresis)
    table.add_row("segments as measured (mm)", _numbers(found.lengths_mm, 1))
    if found.reversed_motors:
        motors = " and ".join(map(str, found.reversed_motors))
        cure = "ccr-host calibrate corrects this; left-handed axes of the tracker look alike"
        table.add_row("reversed", f"motor {motors}; {cure}")
    return table


def _numbers(values: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]], n: int) -> str:
    return ", ".join(f"{float(value):.{n}f}" for value in values)
