"""The command ``ccr-host identify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ccr_host.commands.options import (
    JsonOption,
    KeepInOption,
    RobotOption,
    SetOption,
    console_beside,
    print_json,
)

if TYPE_CHECKING:
    from rich.table import Table

    from ccr_host.tools.identify import Identification
    from ccr_host.tools.measured import Home, Measured, Sweep


def identify(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE.csv", help="Commands and tips, see docs/identify.md."),
    ],
    robot: RobotOption = None,
    overrides: SetOption = None,
    out: KeepInOption = None,
    train: Annotated[
        float,
        typer.Option(
            metavar="SHARE", min=0.05, max=0.95, help="First part of the time, for the fit."
        ),
    ] = 0.5,
    leave_out: Annotated[
        str,
        typer.Option(metavar="REGEX", help="Leave out rows whose pattern contains this."),
    ] = "release",
    one_plane: Annotated[
        bool,
        typer.Option(
            "--one-plane", help="Only rows in which all segments bend within the same plane."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Fit the static model to measurements of any robot, and judge it by the rest of them.

    Example: ccr-host identify rests.csv --robot my-robot.toml
    """
    import datetime
    import re

    import numpy as np

    from ccr_host.core.errors import ConfigError
    from ccr_host.description.file import file_to_keep_in, keep_in
    from ccr_host.description.schema import load
    from ccr_host.tools.identify import identify as identify_robot
    from ccr_host.tools.measured import home_of, read_measured, sweeps_of

    try:
        unwanted = re.compile(leave_out) if leave_out else None
    except re.error as error:
        raise ConfigError(
            f"--leave-out {leave_out}: {error}", "give a regular expression"
        ) from None
    description = load(robot, overrides or ())
    kept_in = file_to_keep_in(robot, out)
    measured = read_measured(file)
    if unwanted is not None:
        stays = [unwanted.search(name) is None for name in measured.pattern.tolist()]
        measured = measured.kept(np.array(stays, dtype=np.bool_))
    found = identify_robot(
        description,
        measured,
        date=datetime.date.today(),
        train_share=train,
        one_plane=one_plane,
    )
    sweeps, home = sweeps_of(measured), home_of(measured)
    screen = console_beside(as_json=as_json)
    screen.print(_residuals(found))
    for line in _facts(measured, sweeps, home):
        screen.print(line, soft_wrap=True)
    screen.print(_parameters(found))
    if kept_in is None:
        screen.print("not saved: give your robot description, or --out FILE")
    else:
        keep_in(kept_in, found.sections, robot)
        screen.print(f"saved in {kept_in}, as section {', '.join(found.sections)}")
    if as_json:
        content = _summary(found, measured, sweeps, home)
        print_json(
            {
                "file": str(file),
                "robot": description.name,
                **content,
                "kept_in": None if kept_in is None else str(kept_in),
            }
        )


def _residuals(found: Identification) -> Table:
    from rich.table import Table

    table = Table(title="distance of the tip from the model (mm)", title_justify="left")
    for heading in ("", "rows", "RMS", "median", "95 %"):
        table.add_column(heading, justify="right")
    for name, residual in (("fitted", found.train), ("held out", found.held_out)):
        table.add_row(
            name,
            str(residual.rows),
            f"{residual.rmse_mm:.2f}",
            f"{residual.median_mm:.2f}",
            f"{residual.p95_mm:.2f}",
        )
    return table


def _facts(measured: Measured, sweeps: list[Sweep], home: Home | None) -> list[str]:
    width = _width(measured, sweeps)
    if width is None:
        hysteresis = "hysteresis: no motion there and back along the same commands"
    else:
        command = (
            f"{width['travel_mm']:.2f} mm of tendon travel"
            if measured.unit == "mm"
            else f"{width['motor_deg']:.2f} deg of motor"
        )
        hysteresis = (
            f"hysteresis: the same command from both sides is {width['tip_mm']:.2f} mm apart at "
            f"the tip, {command} ({width['sweeps']} sweeps)"
        )
    if home is None:
        return [hysteresis, "repeatability: home was not visited twice"]
    repeatability = (
        f"repeatability: {home.rms_mm:.2f} mm RMS about the mean of {home.visits} visits to home, "
        f"at most {home.max_mm:.2f} mm"
    )
    return [hysteresis, repeatability]


def _width(measured: Measured, sweeps: list[Sweep]) -> dict[str, Any] | None:
    import math
    from statistics import fmean

    if not sweeps:
        return None
    command = fmean(sweep.command for sweep in sweeps)
    of_motor = (
        {"travel_mm": command} if measured.unit == "mm" else {"motor_deg": math.degrees(command)}
    )
    return {"sweeps": len(sweeps), "tip_mm": fmean(s.tip_mm for s in sweeps), **of_motor}


def _parameters(found: Identification) -> Table:
    from rich.table import Table

    table = Table(
        title="parameters, from all rows",
        title_justify="left",
        caption="+-: standard deviation; share: of that assumed before; known: at most half of it; "
        "confounded: cannot be told from that one",
        caption_justify="left",
    )
    for heading in ("", "value", "+-", "share", "known", "confounded with"):
        left = heading in ("", "confounded with")
        table.add_column(heading, justify="left" if left else "right", no_wrap=not heading)
    for p in found.parameters:
        share = p.deviation / p.prior_deviation
        confounded = f"{p.confounded_with} ({p.correlation:+.2f})" if p.confounded_with else ""
        table.add_row(
            p.name,
            f"{p.value:.4g}",
            f"{p.deviation:.2g}",
            f"{share:.2f}",
            "yes" if p.identified else "no",
            confounded,
        )
    return table


def _summary(
    found: Identification, measured: Measured, sweeps: list[Sweep], home: Home | None
) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "rows": len(measured.time_s),
        "motors": measured.command.shape[1],
        "train": asdict(found.train),
        "held_out": asdict(found.held_out),
        "hysteresis": _width(measured, sweeps),
        "home": None if home is None else asdict(home),
        "parameters": [{**asdict(p), "identified": p.identified} for p in found.parameters],
    }
