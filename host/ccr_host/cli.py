"""Command line: reads the words, calls the work, prints the result, picks the exit status.

Each command imports what it needs, so that --help and completion stay quick.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console

from ccr_host import terminal
from ccr_host.errors import CcrError, ConfigError
from ccr_host.run.options import RunOptions

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="ccr-host",
    help="Control of tendon-driven continuum robots; without hardware on a digital twin.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

PathArgument = Annotated[
    str,
    typer.Argument(
        metavar="PATH", help="ellipse, 8shape, star, or a CSV file (t_s,y_mm,z_mm[,x_mm])."
    ),
]
ControllerOption = Annotated[str, typer.Option(metavar="NAME", help="Controller to use.")]
RobotOption = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="Robot description, or the name of a shipped one."),
]
DeviceOption = Annotated[
    str,
    typer.Option(
        metavar="URI", help="emulator:, emulator+pty:, simavr:, serial:PORT or tcp://HOST:PORT."
    ),
]
TrackerOption = Annotated[str, typer.Option(metavar="URI", help="twin:, the simulated camera.")]
RateOption = Annotated[float, typer.Option(metavar="HZ", help="Control steps a second.")]
SeedOption = Annotated[int, typer.Option(metavar="N", help="Seed of every random number.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key of the description."),
]
RealtimeOption = Annotated[bool, typer.Option("--realtime", help="Run in real time.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for the results.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the summary alone, as JSON, on standard output.")
]


@app.command()
def track(
    path: PathArgument,
    controller: ControllerOption = "mpc",
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    rate: RateOption = 1.0,
    seed: SeedOption = 1,
    overrides: SetOption = None,
    realtime: RealtimeOption = False,
    with_open: Annotated[
        bool | None,
        typer.Option(
            "--with-open/--no-open",
            help="Also run the open loop, to compare; by default where it costs no time.",
        ),
    ] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Follow a path and show how well.

    Example: ccr-host track 8shape --set twin.payload_g=5
    """
    from ccr_host.run.campaign import in_background
    from ccr_host.run.execute import execute_logged, reference_of
    from ccr_host.run.folder import make_run_folder
    from ccr_host.run.keep import keep_result
    from ccr_host.run.rig import is_simulated

    with _stop_signals_interrupt():
        options = RunOptions(
            path=path,
            controller=controller,
            robot=robot,
            overrides=tuple(overrides or ()),
            device=device,
            tracker=tracker,
            rate_hz=rate,
            seed=seed,
            realtime=realtime,
        )
        reference = reference_of(options)
        folder = make_run_folder(out, f"{reference.name}-{controller}")
        screen = Console(stderr=as_json)
        wanted = is_simulated(options) if with_open is None else with_open
        wanted = wanted and controller != "open-loop"
        twin_open_loop = options.with_controller("open-loop").on_the_twin()
        with in_background(twin_open_loop) if wanted else nullcontext() as open_loop_result:
            title = f"{reference.name}, {controller}"
            with terminal.step_progress(Console(stderr=True), title) as on_step:
                result = execute_logged(options, folder, on_step)
            complete = result.failure is None
            open_loop = open_loop_result() if open_loop_result and complete else None
            summary = keep_result(folder, result, open_loop)
        if result.records:
            screen.print(terminal.run_table(summary))
            for line in terminal.health_lines(summary):
                screen.print(line, highlight=False)
        screen.print(f"kept in {folder}/: figure.png, run.json, log.jsonl", highlight=False)
        if as_json:
            _print_json(summary)
        if result.failure is not None:
            raise result.failure


@app.command()
def compare(
    controller: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this controller; may be repeated. Default: all."),
    ] = None,
    path: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH", help="Only this path; may be repeated. Default: all three."),
    ] = None,
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    rate: RateOption = 1.0,
    seed: SeedOption = 1,
    overrides: SetOption = None,
    realtime: RealtimeOption = False,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Open loop against every controller on the paper's paths.

    Example: ccr-host compare --robot hard
    """
    from ccr_host.control.registry import controller_names
    from ccr_host.run.campaign import execute_all
    from ccr_host.run.execute import reference_of
    from ccr_host.run.figure import write_comparison_figure
    from ccr_host.run.folder import make_run_folder, write_json
    from ccr_host.run.paper_results import PAPER_RESULTS
    from ccr_host.run.summary import summarise

    with _stop_signals_interrupt():
        names = controller or controller_names()
        runs = [
            RunOptions(
                path=one_path,
                controller=name,
                robot=robot,
                overrides=tuple(overrides or ()),
                device=device,
                tracker=tracker,
                rate_hz=rate,
                seed=seed,
                realtime=realtime,
            )
            for one_path in path or PAPER_RESULTS
            for name in names
        ]
        references = {run.path: reference_of(run) for run in runs}
        folder = make_run_folder(out, "compare")
        screen = Console(stderr=as_json)
        results = {}
        with terminal.count_progress(Console(stderr=True), "runs", len(runs)) as count:
            for index, result in execute_all(runs):
                results[index] = result
                count()
        summaries = [summarise(results[index]) for index in range(len(runs))]
        groups = [
            (
                reference,
                [
                    (run.controller, results[index].records)
                    for index, run in enumerate(runs)
                    if run.path == one_path
                ],
            )
            for one_path, reference in references.items()
        ]
        write_comparison_figure(folder / "figure.png", groups)
        content = {"runs": summaries, "paper": {k: vars(v) for k, v in PAPER_RESULTS.items()}}
        write_json(folder / "compare.json", content)
        screen.print(terminal.comparison_table(summaries))
        screen.print(f"kept in {folder}/: figure.png, compare.json", highlight=False)
        if as_json:
            _print_json(content)
        for result in results.values():
            if result.failure is not None:
                raise result.failure


@app.command()
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
    screen = Console(stderr=as_json)
    screen.print(terminal.reach_table(reach))
    screen.print(f"kept in {folder}/: figure.png, workspace.json", highlight=False)
    if as_json:
        _print_json(reach)


@app.command()
def emulate(
    tcp: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Serve on TCP; port 0 takes a free one."),
    ] = None,
    pty: Annotated[
        bool, typer.Option("--pty", help="Serve on a pseudo-terminal (the default).")
    ] = False,
    simavr: Annotated[
        bool,
        typer.Option("--simavr", help="The real firmware in simavr, on a pty, flashable."),
    ] = False,
    eeprom: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep the EEPROM in this file.")
    ] = None,
    boot_ms: Annotated[
        int, typer.Option(min=0, help="How long the boot loader is deaf after the port is opened.")
    ] = 1000,
) -> None:
    """Serve the emulated board in real time, for this host or for your own.

    Example: ccr-host emulate --tcp 127.0.0.1:5025
    """
    from ccr_host.emulator.serve import open_server

    if tcp is not None and (pty or simavr):
        raise ConfigError("--tcp with --pty or --simavr", "start one board for each")
    if simavr:
        from ccr_host.simavr.files import find_firmware
        from ccr_host.simavr.serve import open_pty_server

        server = open_pty_server(find_firmware(), eeprom_file=eeprom)
    else:
        server = open_server(tcp, eeprom, boot_loader_us=boot_ms * 1000)
    typer.echo(f"emulated board on {server.uri}; Ctrl-C ends it")
    typer.echo(f"try: ccr-host track 8shape --device {server.uri}")
    server.run_until_signal()


@app.command()
def flash(
    firmware: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="HEX or ELF file; without it the checkout is built."),
    ] = None,
    port: Annotated[
        str | None, typer.Option(metavar="PORT", help="Serial port; found where there is only one.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Put the firmware onto an UNO and ask it who it is.

    Example: ccr-host flash --port /dev/ttyACM0
    """
    from ccr_host.flash.flash import flash_board

    report = flash_board(port, firmware)
    screen = Console(stderr=as_json)
    screen.print(
        f"{report.port}: firmware {report.firmware_version} answers, "
        f"boot {report.identity.boot_id}, EEPROM {report.identity.eeprom_status.name.lower()}",
        highlight=False,
    )
    if as_json:
        _print_json(report.summary())


def main() -> None:
    """Entry point of ``ccr-host``: whatever goes wrong is one line on standard error."""
    try:
        status = app(sys.argv[1:] or ["--help"], prog_name="ccr-host", standalone_mode=False)
    except typer.TyperException as error:
        _leave(f"error: {error.format_message()} See ccr-host --help.", EXIT_USAGE)
    except CcrError as error:
        cure = f"; {error.cure}" if error.cure else ""
        _leave(f"error: {error.cause}{cure}", error.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        _leave("interrupted", EXIT_INTERRUPTED)
    sys.exit(status)


def _leave(message: str, status: int) -> NoReturn:
    # The terminal may be gone, which must not change the status.
    with suppress(OSError):
        sys.stderr.write(f"ccr-host: {message}\n")
        sys.stderr.flush()
    sys.exit(status)


def _print_json(content: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(content) + "\n")
    sys.stdout.flush()


@contextmanager
def _stop_signals_interrupt() -> Iterator[None]:
    """A closed terminal or a polite kill ends a run like Ctrl-C: the robot is made safe first."""

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    signals = (signal.SIGTERM, signal.SIGHUP)
    previous = [signal.signal(number, interrupt) for number in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, previous, strict=True):
            signal.signal(number, handler)
