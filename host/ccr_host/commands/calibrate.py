"""The command ``ccr-host calibrate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from ccr_host.commands.options import (
    DeviceOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
)
from ccr_host.commands.stopping import stop_signals_interrupt
from ccr_host.run.options import RunOptions

if TYPE_CHECKING:
    from ccr_host.config import Description, Servo
    from ccr_host.run.rig import Rig


def calibrate(
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    seed: SeedOption = 1,
    overrides: SetOption = None,
    by_eye: Annotated[
        bool,
        typer.Option(
            "--by-eye",
            help="Lead each servo to marked angles with the arrow keys; finds limits as well.",
        ),
    ] = False,
) -> None:
    """Find neutral pulse, direction and scale of the servos, and keep them.

    Example: ccr-host calibrate --by-eye --robot my-robot.toml --device serial:/dev/ttyACM0
    """
    from ccr_host.bringup.keep_calibration import (
        calibrated_section,
        keep_calibration,
        writable_description,
    )
    from ccr_host.run.observer import Observers
    from ccr_host.run.rig import open_rig

    file = writable_description(robot)
    options = RunOptions(
        path="",
        robot=robot,
        device=device,
        tracker=tracker,
        seed=seed,
        overrides=tuple(overrides or ()),
        realtime=by_eye,
    )
    description = options.description()
    console = Console()
    with stop_signals_interrupt(), open_rig(options, description, Observers()) as rig:
        servo = _by_eye(console, rig, description) if by_eye else None
        if servo is None:
            console.print("nothing was changed")
            return
        keep_calibration(rig.client, description, servo, file)
    for key, value in calibrated_section(servo).items():
        console.print(f"{key} = {value}", highlight=False)
    console.print(f"kept in {file} and in the board's EEPROM", highlight=False)


def _by_eye(console: Console, rig: Rig, description: Description) -> Servo | None:
    from rich.live import Live

    from ccr_host.bringup.calibrate_by_eye import calibrate_by_eye
    from ccr_host.bringup.jog import JogView
    from ccr_host.bringup.jog_screen import jog_panel
    from ccr_host.bringup.keyboard import Keyboard
    from ccr_host.bringup.servo_marks import QUESTIONS, Question

    with Keyboard() as keyboard, Live(console=console, auto_refresh=False) as live:

        def show(view: JogView, question: Question, answered: int) -> None:
            asked = f"{answered + 1} of {len(QUESTIONS)}: {question.text}"
            live.update(jog_panel(view, asked), refresh=True)

        return calibrate_by_eye(rig, description, keyboard.pressed, show)
