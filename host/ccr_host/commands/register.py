"""The command ``ccr-host register``."""

from __future__ import annotations

import typer

from ccr_host.commands.options import (
    DeviceOption,
    JsonOption,
    KeepInOption,
    PlantOption,
    RealtimeOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
    console,
    print_json,
    require_named_tracker,
)
from ccr_host.run.options import RigOptions


def register(
    context: typer.Context,
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    plant: PlantOption = "twin",
    seed: SeedOption = 1,
    overrides: SetOption = None,
    realtime: RealtimeOption = False,
    out: KeepInOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the camera's orientation in safe poses of the robot. Saved in the file.

    Example: ccr-host register --robot my-robot.toml --device serial:/dev/ttyACM0
    --tracker ndi:/dev/ttyUSB0
    """
    import datetime
    import math

    from ccr_host.commands import terminal
    from ccr_host.commands.tracker_screen import registration_table
    from ccr_host.description.file import file_to_keep_in, keep_in
    from ccr_host.robot.workspace import MotorLimits
    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig
    from ccr_host.tools.register import (
        REGISTRATION,
        register_robot,
        registration_section,
        safe_poses_rad,
    )

    options = RigOptions(
        robot=robot,
        device=device,
        tracker=tracker,
        plant=plant,
        seed=seed,
        overrides=tuple(overrides or ()),
        realtime=realtime,
    )
    require_named_tracker(context, options)
    description = options.description()
    file = file_to_keep_in(robot, out)
    screen = console(on_stderr=as_json)
    poses = len(safe_poses_rad(MotorLimits.of(description.servo)))
    with (
        terminal.count_progress(console(on_stderr=True), "poses", poses) as count,
        open_rig(options, description, Observers(), in_camera_frame=True) as rig,
    ):
        found = register_robot(rig, description, lambda done, _: count() if done else None)
    section = registration_section(found, datetime.date.today())
    screen.print(registration_table(found))
    if file is None:
        screen.print("not saved: give your robot description, or --out FILE")
    else:
        keep_in(file, {REGISTRATION: section}, robot)
        screen.print(f"saved in {file}, as section {REGISTRATION}")
    if as_json:
        print_json(
            {
                **section,
                "date": section["date"].isoformat(),
                "segment_1_mm": found.segment_1_mm,
                "hysteresis_mm": [
                    None if math.isnan(half_mm) else round(float(half_mm), 2)
                    for half_mm in found.hysteresis_mm
                ],
                "reversed_motors": list(found.reversed_motors),
                "device": device,
                "tracker": tracker,
                "seed": seed,
                "kept_in": None if file is None else str(file),
            }
        )
