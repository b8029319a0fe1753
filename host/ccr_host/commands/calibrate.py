"""The command ``ccr-host calibrate``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ccr_host.commands.options import KeepInOption, console, require_named_tracker
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from rich.console import Console

    from ccr_host.description.schema import Description, Servo
    from ccr_host.run.rig import Rig
    from ccr_host.tools.survey_fit import Survey


def calibrate(
    context: typer.Context,
    rig: RigOptions,
    out: KeepInOption = None,
    by_eye: Annotated[
        bool,
        typer.Option(
            "--by-eye",
            help="Move each servo to marked angles with the arrow keys; also sets the limits.",
        ),
    ] = False,
    identify: Annotated[
        bool,
        typer.Option(
            "--identify",
            help="Measure rest positions and save them in the file alone: controller `adaptive` "
            "then needs no tour before each path.",
        ),
    ] = False,
    board_name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Name the board in its EEPROM; robot.board_name requires it."
        ),
    ] = None,
    emergency_stop: Annotated[
        bool | None,
        typer.Option(help="Whether a switch is wired to the board's emergency-stop input."),
    ] = None,
    supply_divider: Annotated[
        float | None,
        typer.Option(metavar="N", help="Servo supply over the voltage at pin A0; 0: not wired."),
    ] = None,
    supply_min: Annotated[
        float | None,
        typer.Option(metavar="V", help="A lower servo supply is a fault while armed; 0: off."),
    ] = None,
) -> None:
    """Measure how servos and tendons are mounted. Saved in file and board.

    With the tracker: neutral pulse, direction and slack, from the tour of register, whose results
    are saved as well.
    By eye: neutral pulse, direction, scale and limits.
    With --identify, once servos are calibrated and the camera registered: rest positions alone.
    With --board-name, --emergency-stop or --supply-...: saved in the board; nothing moves.

    Example: ccr-host calibrate --by-eye --robot my-robot.toml --device serial:/dev/ttyACM0
    """
    from ccr_host.core.errors import ConfigError
    from ccr_host.description.file import keep_in
    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig, sees_simulated_robot
    from ccr_host.tools.equipment import EquipmentChange, set_equipment
    from ccr_host.tools.survey import (
        IDENTIFIED,
        calibrated_section,
        corrected,
        file_for_calibration,
        keep_calibration,
    )

    change = EquipmentChange(board_name, emergency_stop, supply_divider, supply_min)
    if by_eye and identify:
        raise ConfigError("--identify needs the tracker", "omit --by-eye")
    if change != EquipmentChange():
        if by_eye or identify or out:
            raise ConfigError(
                "--board-name, --emergency-stop and --supply-... are saved only in the board",
                "omit --by-eye, --identify and --out",
            )
        console().print(f"the board is now: {set_equipment(rig, change)}; saved in its EEPROM")
        return
    file = file_for_calibration(rig.robot, out)
    description = rig.description()
    if not by_eye:
        require_named_tracker(context, rig)
    screen = console()
    found = None
    in_camera_frame = not (by_eye or identify)
    if by_eye:
        rig = replace(rig, realtime=True)
    with open_rig(rig, description, Observers(), in_camera_frame=in_camera_frame) as opened:
        if identify:
            section = _identify(screen, opened, description)
            keep_in(file, {IDENTIFIED: section}, rig.robot)
            screen.print(f"saved in {file}, as section {IDENTIFIED}")
            return
        if by_eye:
            blind = sees_simulated_robot(rig)
            servo = move_by_eye(screen, opened, description, simulated_tip=blind)
        else:
            found = survey_by_tracker(screen, opened, description)
            servo = corrected(description.servo, found)
        if servo is None:
            screen.print("nothing changed")
            return
        keep_calibration(opened.client, description, servo, file, rig.robot, found)
    for key, value in calibrated_section(servo).items():
        screen.print(f"{key} = {value}")
    screen.print(f"saved in {file} and in the board's EEPROM")


def move_by_eye(
    screen: Console, rig: Rig, description: Description, *, simulated_tip: bool
) -> Servo | None:
    """Ask for the marks on a terminal; None if the user quits before the last one."""
    from rich.live import Live

    from ccr_host.commands.jog import jog_panel
    from ccr_host.tools.calibrate import calibrate_by_eye
    from ccr_host.tools.jog import JogView, Keyboard

    with Keyboard() as keyboard, Live(console=screen, auto_refresh=False) as live:

        def show(view: JogView, asked: str) -> None:
            panel = jog_panel(
                view, simulated_tip=simulated_tip, title="calibrate by eye", asked=asked
            )
            live.update(panel, refresh=True)

        return calibrate_by_eye(rig, description, keyboard.pressed, show)


def survey_by_tracker(screen: Console, rig: Rig, description: Description) -> Survey:
    """Make the tour on a terminal, and print its results."""
    from ccr_host.commands import terminal
    from ccr_host.commands.register import registration_table
    from ccr_host.tools.calibrate import calibration_table
    from ccr_host.tools.survey import survey

    with terminal.pose_progress() as on_pose:
        found = survey(rig, description, on_pose)
    screen.print(registration_table(found))
    screen.print(calibration_table(found, description))
    return found


def _identify(screen: Console, rig: Rig, description: Description) -> dict[str, Any]:
    import datetime

    from ccr_host.commands import terminal
    from ccr_host.tools.survey import identified_section, measure_rests, trial_fit

    with terminal.pose_progress() as on_pose:
        rests = measure_rests(rig, description, on_pose)
    fit = trial_fit(rests, description)
    screen.print(f"{len(rests.count)} rests; {fit.residual}")
    return identified_section(rests, description, datetime.date.today())
