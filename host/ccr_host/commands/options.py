"""Arguments and options that several commands take."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from ccr_host.core.errors import ConfigError
from ccr_host.core.standard_streams import warn
from ccr_host.core.user_file import printable
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from ccr_host.record.folder import ResultFolder


def complete_controllers(incomplete: str) -> list[str]:
    """Names of controllers; where none fits, the shell itself offers files."""
    from ccr_host.control.registry import baseline_names, controller_names
    from ccr_host.core.plugins import plugin_names

    names = [*controller_names(), *baseline_names(), *plugin_names("controller")]
    return _beginning_with(incomplete, names)


def complete_trackers(incomplete: str) -> list[str]:
    """Schemes of trackers; where none fits, the shell itself offers files."""
    from ccr_host.core.addresses import Role, known_forms
    from ccr_host.core.plugins import FORM

    forms = [form for form in known_forms(Role.TRACKER) if form != FORM]
    return _beginning_with(incomplete, [f"{form.partition(':')[0]}:" for form in forms])


def complete_plants(incomplete: str) -> list[str]:
    """Names of simulated robots; where none fits, the shell itself offers files."""
    from ccr_host.core.plugins import plugin_names
    from ccr_host.sim.robot.plant import TWIN

    return _beginning_with(incomplete, [TWIN, *plugin_names("plant")])


def complete_paths(incomplete: str) -> list[str]:
    """Names of built-in paths; where none fits, the shell itself offers files."""
    from ccr_host.robot.paths import path_names

    return _beginning_with(incomplete, path_names())


def complete_robots(incomplete: str) -> list[str]:
    """Names of shipped descriptions; where none fits, the shell itself offers files."""
    from ccr_host.description.source import shipped_descriptions

    return _beginning_with(incomplete, shipped_descriptions())


def _beginning_with(incomplete: str, names: list[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


_USUAL_WIDTH = 80


def console(*, on_stderr: bool = False) -> Console:
    """For text that may contain anything, such as the brackets of a file's name."""
    made = Console(stderr=on_stderr, markup=False, highlight=False)
    if made.width < 1:  # COLUMNS=0, as terminals of unknown size have it: nothing would be printed
        made.width = _USUAL_WIDTH
    return made


def tell_kept(screen: Console, folder: ResultFolder, *further_troubles: str) -> None:
    """Where the results are; in one line on standard error, what is missing."""
    if folder.kept:
        where = printable(str(folder.path))
        screen.print(f"kept in {where}/: {', '.join(folder.kept)}", soft_wrap=True)
    troubles = [trouble for trouble in (folder.trouble, *further_troubles) if trouble]
    if troubles:
        warn(f"{folder.path}: {'; '.join(troubles)}")


def print_json(content: dict[str, Any]) -> None:
    """One object on one line of standard output."""
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


PathArgument = Annotated[
    str,
    typer.Argument(
        metavar="PATH",
        help="ellipse, 8shape, star, or a table in a file (t_s,y_mm,z_mm[,x_mm]).",
        autocompletion=complete_paths,
    ),
]
ControllerOption = Annotated[
    str,
    typer.Option(
        metavar="NAME", help="A controller, or FILE.py:CLASS.", autocompletion=complete_controllers
    ),
]
RobotOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Robot description, or the name of a shipped one.",
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
RateOption = Annotated[float, typer.Option(metavar="HZ", help="Control steps a second.")]
SeedOption = Annotated[
    int, typer.Option(metavar="N", min=0, max=2**63 - 1, help="Seed of every random number.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one key of the description; may be repeated."
    ),
]
UncheckedOption = Annotated[
    bool,
    typer.Option(
        "--unchecked", help="Follow the path whatever markers and motion of the robot look like."
    ),
]
RealtimeOption = Annotated[bool, typer.Option("--realtime", help="Run in real time.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the results.")]
KeepInOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help="Robot description to keep the result in, made if it is not there; "
        "by default the one of --robot.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the summary alone, as JSON, on standard output.")
]


def warn_of_mismatch(options: RigOptions) -> None:
    """Say so where the board is real and the robot simulated, or the other way round.

    Raises:
        ConfigError: the device or tracker URI is not one.
    """
    from ccr_host.run.open_rig import mismatch_of

    if mismatch := mismatch_of(options):
        console(on_stderr=True).print(f"note: {mismatch}")


def require_named_tracker(context: typer.Context, options: RigOptions) -> None:
    """Refuse to fit a real board's servos to a simulated robot that nobody has asked for.

    Raises:
        ConfigError: so it would be; or the device or tracker URI is not one.
    """
    from ccr_host.run.open_rig import sees_simulated_robot

    source = context.get_parameter_source("tracker")
    unnamed = source is not None and source.name == "DEFAULT"
    if unnamed and sees_simulated_robot(options):
        raise ConfigError(
            f"no tracker was named: the board on {options.device} would be fitted to the simulated "
            "robot",
            "name the camera with --tracker; --tracker twin: asks for the simulated one",
        )
