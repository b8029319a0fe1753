"""The command ``ccr-host jog``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ccr_host.commands.options import Without, console
from ccr_host.robot.reference import PATH_AXES
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from ccr_host.tools.jog import JogView

_BAR_CELLS = 30


def jog_panel(
    view: JogView, *, simulated_tip: bool, title: str = "jog", asked: str = ""
) -> RenderableType:
    """Motors, board, markers and keys, and below them a question to the user.

    With ``simulated_tip`` the board drives a real robot but the tip is the twin's.
    """
    from ccr_host.tools.jog import HELP_BACK

    question = Text(f"\n{asked}", style="bold") if asked else Text()
    keys = [*view.target.help, *([HELP_BACK] if asked else [])]
    return Panel(
        Group(
            _motors(view), _state(view), _tip(view, simulated_tip), Text(), _keys(keys), question
        ),
        title=f"{title}, {view.target.step_deg:g} deg per key",
        title_align="left",
    )


def _motors(view: JogView) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_row("", "target (deg)", "board (deg)", "pulse (us)", "range (deg)", "")
    target = view.target
    asked = np.degrees(target.q_rad)
    lower, upper = np.degrees(target.limits.lower_rad), np.degrees(target.limits.upper_rad)
    many = len(asked) > len(target.moved)
    for axis in range(len(asked)):
        board = pulse = "-"
        if view.report is not None:
            board = f"{view.report.setpoint_cdeg[axis] / 100:.2f}"
            half_us = view.report.pulse_half_us[axis]
            pulse = f"{half_us / 2:.1f}" if half_us else "none"
        share = (asked[axis] - lower[axis]) / (upper[axis] - lower[axis])
        table.add_row(
            f"motor {axis + 1}" + (" <" if many and axis in target.moved else ""),
            f"{asked[axis]:.2f}",
            board,
            pulse,
            f"{lower[axis]:g} .. {upper[axis]:g}",
            _bar(share),
        )
    return table


def _bar(share: float) -> str:
    place = round(share * (_BAR_CELLS - 1))
    return "-" * place + "o" + "-" * (_BAR_CELLS - 1 - place)


def _state(view: JogView) -> Text:
    state = "no report yet" if view.report is None else view.report.state.name.lower()
    if view.report is not None and view.report.supply_dv:
        state += f", servo supply {view.report.supply_dv / 10:g} V"
    if view.trouble:
        return Text(f"board: {state}; {view.trouble}; press c to arm again", style="bold red")
    return Text(f"board: {state}")


def _tip(view: JogView, simulated: bool) -> Text:
    if simulated:
        return Text(
            "tip: not shown, as it is simulated; give your tracker with --tracker", style="dim"
        )
    if view.sample is None or view.sample_age_us is None:
        return Text("tip: no markers", style="yellow")
    tip_mm = view.sample.tip_mm
    shown = ", ".join(f"{axis} {tip_mm[component]:.2f}" for axis, component in PATH_AXES.items())
    return Text(f"tip: {shown} mm, {view.sample_age_us / 1000:.0f} ms old")


def _keys(help_lines: Iterable[tuple[str, str]]) -> Table:
    table = Table.grid(padding=(0, 2))
    for keys, meaning in help_lines:
        table.add_row(keys, meaning, style="dim")
    return table


def jog(rig: Annotated[RigOptions, Without("realtime")]) -> None:
    """Move the motors with the arrow keys. Shows the live state and has a stop key.

    Example: ccr-host jog --device serial:/dev/ttyACM0
    """
    from rich.live import Live

    from ccr_host.run.observer import Observers
    from ccr_host.run.open_rig import open_rig, sees_simulated_robot
    from ccr_host.tools.jog import Keyboard
    from ccr_host.tools.jog import jog as move_by_hand

    options = replace(rig, realtime=True)
    description = options.description()
    screen = console()
    with (
        Keyboard() as keyboard,
        open_rig(options, description, Observers()) as opened,
        Live(console=screen, auto_refresh=False) as live,
    ):

        def show(view: JogView) -> None:
            panel = jog_panel(view, simulated_tip=sees_simulated_robot(options))
            live.update(panel, refresh=True)

        move_by_hand(opened, description, keyboard.pressed, show)
    screen.print("disarmed: no pulses to the servos")
