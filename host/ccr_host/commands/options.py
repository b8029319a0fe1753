"""Arguments and options shared by several commands."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from ccr_host.core.errors import ConfigError
from ccr_host.core.standard_streams import keep_output_for_summary, output, warn
from ccr_host.core.user_file import printable
from ccr_host.run.options import RigOptions, RunOptions, SurfaceName

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ccr_host.record.folder import ResultFolder


def complete_controllers(incomplete: str) -> list[str]:
    """Matching names of controllers; if there are none, the shell completes files."""
    from ccr_host.control.registry import baseline_names, controller_names
    from ccr_host.core.plugins import plugin_names

    names = [*controller_names(), *baseline_names(), *plugin_names("controller")]
    return _starting_with(incomplete, names)


def complete_trackers(incomplete: str) -> list[str]:
    """Matching schemes of trackers; if there are none, the shell completes files."""
    from ccr_host.core.addresses import Role, known_forms
    from ccr_host.core.plugins import FORM

    forms = [form for form in known_forms(Role.TRACKER) if not form.startswith(FORM)]
    return _starting_with(incomplete, [f"{form.partition(':')[0]}:" for form in forms])


def complete_plants(incomplete: str) -> list[str]:
    """Matching names of simulated robots; if there are none, the shell completes files."""
    from ccr_host.core.plugins import plugin_names
    from ccr_host.sim.robot.plant import TWIN

    return _starting_with(incomplete, [TWIN, *plugin_names("plant")])


def complete_paths(incomplete: str) -> list[str]:
    """Matching names of built-in paths; if there are none, the shell completes files."""
    from ccr_host.robot.paths import path_names

    return _starting_with(incomplete, path_names())


def complete_robots(incomplete: str) -> list[str]:
    """Matching names of shipped descriptions; if there are none, the shell completes files."""
    from ccr_host.description.source import shipped_descriptions

    return _starting_with(incomplete, shipped_descriptions())


def _starting_with(incomplete: str, names: list[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


_USUAL_WIDTH = 80


def console(*, on_stderr: bool = False) -> Console:
    """Console without markup, as text may contain brackets, e.g. in the name of a file."""
    made = Console(stderr=on_stderr, markup=False, highlight=False)
    if made.width < 1:  # COLUMNS=0 on terminals of unknown size: nothing would be printed
        made.width = _USUAL_WIDTH
    return made


def console_beside(*, as_json: bool) -> Console:
    """Console of a command whose summary alone, if it is asked for, is on standard output.

    What plug-ins print goes to standard error then.
    """
    if as_json:
        keep_output_for_summary()
    return console(on_stderr=as_json)


def tell_kept(screen: Console, folder: ResultFolder, *further_troubles: str) -> None:
    """Print where the results are, and what is missing in one line on standard error."""
    if folder.kept:
        where = printable(str(folder.path))
        screen.print(f"saved in {where}/: {', '.join(folder.kept)}", soft_wrap=True)
    troubles = [trouble for trouble in (folder.trouble, *further_troubles) if trouble]
    if troubles:
        warn(f"{folder.path}: {'; '.join(troubles)}")


def print_json(content: dict[str, Any]) -> None:
    """Print one object on one line of standard output."""
    output().write(json.dumps(content) + "\n")
    output().flush()


PathArgument = Annotated[
    str,
    typer.Argument(
        metavar="PATH",
        help="ellipse, 8shape, star, swing, circle, helix, dome8, letters, or a table in a file "
        "(t_s,y_mm,z_mm[,x_mm]).",
        autocompletion=complete_paths,
    ),
]
ControllerOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="A controller, or FILE.py:CLASS; adaptive by default.",
        autocompletion=complete_controllers,
    ),
]
RobotOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Robot description, or a shipped one: default, dirty, hard, ideal, loose-tendons, "
        "paper, single, soft, three-spatial, tool-tip, two-spatial.",
        autocompletion=complete_robots,
    ),
]
DeviceOption = Annotated[
    str,
    typer.Option(
        metavar="URI", help="emulator:, emulator+pty:, simavr:, serial:PORT or tcp://HOST:PORT."
    ),
]
TrackerOption = Annotated[
    str,
    typer.Option(
        metavar="URI",
        help="twin:, ndi-emulator:, ndi:PORT, ndi+tcp://HOST:PORT, igtl://HOST:PORT, aruco:N, "
        "replay:FILE or FILE.py:CLASS.",
        autocompletion=complete_trackers,
    ),
]
PlantOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="The simulated robot: twin, or FILE.py:CLASS.",
        autocompletion=complete_plants,
    ),
]
RateOption = Annotated[float, typer.Option(metavar="HZ", help="Control steps per second.")]
SeedOption = Annotated[
    int, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Seed of all random numbers.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one key of the description; may be repeated."
    ),
]
UncheckedOption = Annotated[
    bool,
    typer.Option("--unchecked", help="Skip the checks of the robot's markers and motion."),
]
SurfaceOption = Annotated[
    SurfaceName,
    typer.Option(
        help="Whose surface gives a lateral path its x: the model's (10), or the robot's as "
        "identified (calibrate --identify)."
    ),
]
RealtimeOption = Annotated[bool, typer.Option("--realtime", help="Run in real time.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the results.")]
PublishOption = Annotated[
    str | None,
    typer.Option(
        metavar="URI",
        help="Serve the run to 3D Slicer and others: igtl://[HOST]:PORT, this computer by default.",
    ),
]
KeepInOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help="Robot description to save the result in, created if missing; "
        "by default the one of --robot.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the summary alone, as JSON, on standard output.")
]

_OF_RIG: dict[str, Any] = {
    "robot": RobotOption,
    "device": DeviceOption,
    "tracker": TrackerOption,
    "plant": PlantOption,
    "seed": SeedOption,
    "overrides": SetOption,
    "realtime": RealtimeOption,
}
"""The option of each field of RigOptions."""


class Without:
    """What a command has no option for, in ``rig: Annotated[RigOptions, Without(...)]``.

    These fields keep their defaults.
    """

    def __init__(self, *names: str) -> None:
        self.names = names


def with_rig_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command as typer needs it: with options in place of the RigOptions called ``rig``."""
    signature = inspect.signature(command, eval_str=True)
    if (rig := signature.parameters.get("rig")) is None:
        return command
    notes = getattr(rig.annotation, "__metadata__", ())
    left_out = {name for note in notes for name in note.names}
    options = [
        rig.replace(name=name, annotation=option, default=getattr(RigOptions, name))
        for name, option in _OF_RIG.items()
        if name not in left_out
    ]
    parameters: list[inspect.Parameter] = []
    for own in signature.parameters.values():
        parameters += options if own is rig else [own]
    parameters = [each.replace(kind=each.KEYWORD_ONLY) for each in parameters]

    @wraps(command)
    def called(**words: object) -> None:
        given: dict[str, Any] = {option.name: words.pop(option.name) for option in options}
        given["overrides"] = tuple(given["overrides"] or ())
        command(rig=RigOptions(**given), **words)

    vars(called)["__signature__"] = signature.replace(parameters=parameters)
    called.__annotations__ = {each.name: each.annotation for each in parameters}
    return called


def print_notes(runs: Sequence[RunOptions]) -> None:
    """Print a line for each thing about runs on one rig that is allowed, but hardly meant.

    Raises:
        ConfigError: the device or tracker URI is invalid.
    """
    from ccr_host.control.registry import rate_note
    from ccr_host.run.open_rig import mismatch_of

    described = runs[0].description()
    notes = [mismatch_of(runs[0]), *(rate_note(r.controller, r.rate_hz, described) for r in runs)]
    for note in dict.fromkeys(filter(None, notes)):
        console(on_stderr=True).print(f"note: {note}", soft_wrap=True)


def require_named_tracker(context: typer.Context, options: RigOptions) -> None:
    """Refuse to fit the servos of a real board to a robot that is simulated only by default.

    Raises:
        ConfigError: that would happen; or the device or tracker URI is invalid.
    """
    from ccr_host.run.open_rig import sees_simulated_robot

    source = context.get_parameter_source("tracker")
    unnamed = source is not None and source.name == "DEFAULT"
    if unnamed and sees_simulated_robot(options):
        raise ConfigError(
            f"no --tracker was given: the board on {options.device} would be fitted to the "
            "simulated robot",
            "give your camera with --tracker; --tracker twin: if you want the simulated one",
        )
