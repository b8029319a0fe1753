"""The command ``ccr-host workspace``."""

from __future__ import annotations

from typing import Any

import numpy as np

from ccr_host.commands.options import (
    JsonOption,
    OutOption,
    PathArgument,
    RateOption,
    RobotOption,
    SetOption,
    console_beside,
    print_json,
    tell_kept,
)
from ccr_host.robot.reference import Reference
from ccr_host.run.options import RunOptions


def reach_of(reference: Reference) -> dict[str, Any]:
    """Reachability of a path: unreachable steps, unavoidable error (mm), motor travel (deg)."""
    unavoidable_mm = reference.unavoidable_mm
    q_deg = np.degrees(reference.q_rad)
    worst = int(np.argmax(unavoidable_mm))
    return {
        "path": reference.name,
        "steps": len(reference.time_s),
        "unreachable_steps": reference.unreachable_steps,
        "floor_mean_error_mm": reference.floor_mean_mm,
        "floor_max_error_mm": float(unavoidable_mm[worst]),
        "floor_max_at_s": float(reference.time_s[worst]),
        "motor_range_deg": np.stack([q_deg.min(axis=0), q_deg.max(axis=0)], axis=1).tolist(),
        "motor_step_max_deg": np.abs(np.diff(q_deg, axis=0)).max(axis=0).tolist(),
    }


def workspace(
    path: PathArgument,
    robot: RobotOption = None,
    rate: RateOption = 1.0,
    overrides: SetOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the reachable points of a path and the unavoidable error.

    Example: ccr-host workspace ellipse --set servo.angle_max_deg=40
    """
    from ccr_host.commands import terminal
    from ccr_host.record.figure import write_workspace_figure
    from ccr_host.record.folder import FIGURES, ResultFolder
    from ccr_host.run.execute import reference_of, workspace_of

    options = RunOptions(path=path, robot=robot, rate_hz=rate, overrides=tuple(overrides or ()))
    reference = reference_of(options)
    reach = reach_of(reference)
    screen = console_beside(as_json=as_json)
    with ResultFolder(out, f"{reference.name}-workspace") as folder:
        folder.keep_json("workspace.json", reach)
        reachable = workspace_of(options)
        folder.keep(lambda file: write_workspace_figure(file, reference, reachable), *FIGURES)
    screen.print(terminal.reach_table(reach))
    tell_kept(screen, folder)
    if as_json:
        print_json(reach)
