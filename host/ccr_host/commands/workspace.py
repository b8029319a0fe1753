"""The command ``ccr-host workspace``."""

from __future__ import annotations

from ccr_host import terminal
from ccr_host.commands.options import (
    JsonOption,
    OutOption,
    PathArgument,
    RateOption,
    RobotOption,
    SetOption,
)
from ccr_host.commands.output import console, print_json
from ccr_host.run.options import RunOptions


def workspace(
    path: PathArgument,
    robot: RobotOption = None,
    rate: RateOption = 1.0,
    overrides: SetOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say what of a path two motors can reach, and the error that no controller can avoid.

    Example: ccr-host workspace ellipse --set servo.angle_max_deg=40
    """
    from ccr_host.run.execute import reference_of, workspace_of
    from ccr_host.run.figure import write_workspace_figure
    from ccr_host.run.folder import make_run_folder, write_json
    from ccr_host.run.reach import reach_of

    options = RunOptions(path=path, robot=robot, rate_hz=rate, overrides=tuple(overrides or ()))
    reference = reference_of(options)
    reach = reach_of(reference)
    folder = make_run_folder(out, f"{reference.name}-workspace")
    write_workspace_figure(folder / "figure.png", reference, workspace_of(options))
    write_json(folder / "workspace.json", reach)
    screen = console(on_stderr=as_json)
    screen.print(terminal.reach_table(reach))
    screen.print(f"kept in {folder}/: figure.png, workspace.json")
    if as_json:
        print_json(reach)
