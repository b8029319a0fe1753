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
from ccr_host.commands.output import console, print_json, tell_kept
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
    from ccr_host.run.folder import FIGURES, ResultFolder
    from ccr_host.run.reach import reach_of

    options = RunOptions(path=path, robot=robot, rate_hz=rate, overrides=tuple(overrides or ()))
    reference = reference_of(options)
    reach = reach_of(reference)
    screen = console(on_stderr=as_json)
    with ResultFolder(out, f"{reference.name}-workspace") as folder:
        folder.keep_json("workspace.json", reach)
        reachable = workspace_of(options)
        folder.keep(lambda file: write_workspace_figure(file, reference, reachable), *FIGURES)
    screen.print(terminal.reach_table(reach))
    tell_kept(screen, folder)
    if as_json:
        print_json(reach)
