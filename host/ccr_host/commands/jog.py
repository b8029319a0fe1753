"""The command ``ccr-host jog``."""

from __future__ import annotations

from ccr_host.commands.options import (
    DeviceOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
    console,
)
from ccr_host.run.options import RigOptions


def jog(
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    seed: SeedOption = 1,
    overrides: SetOption = None,
) -> None:
    """Move the motors with the arrow keys, with live state and a stop key.

    Example: ccr-host jog --device serial:/dev/ttyACM0
    """
    from rich.live import Live

    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig, sees_simulated_robot
    from ccr_host.tools.jog import JogView
    from ccr_host.tools.jog import jog as move_by_hand
    from ccr_host.tools.jog_screen import jog_panel
    from ccr_host.tools.keyboard import Keyboard

    options = RigOptions(
        robot=robot,
        device=device,
        tracker=tracker,
        seed=seed,
        overrides=tuple(overrides or ()),
        realtime=True,
    )
    description = options.description()
    screen = console()
    with (
        Keyboard() as keyboard,
        open_rig(options, description, Observers()) as rig,
        Live(console=screen, auto_refresh=False) as live,
    ):

        def show(view: JogView) -> None:
            panel = jog_panel(view, simulated_tip=sees_simulated_robot(options))
            live.update(panel, refresh=True)

        move_by_hand(rig, description, keyboard.pressed, show)
    screen.print("disarmed: the servos get no pulses")
