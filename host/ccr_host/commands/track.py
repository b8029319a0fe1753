"""The command ``ccr-host track``."""

from __future__ import annotations

from contextlib import ExitStack, nullcontext
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ccr_host.commands.options import (
    ControllerOption,
    JsonOption,
    OutOption,
    PathArgument,
    PublishOption,
    RateOption,
    SurfaceOption,
    UncheckedOption,
    console,
    console_beside,
    print_json,
    print_notes,
    tell_kept,
)
from ccr_host.commands.view import ViewOption
from ccr_host.run.options import RigOptions, RunOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from ccr_host.run.observer import RunObserver
    from ccr_host.run.summary import RunResult


def track(
    path: PathArgument,
    rig: RigOptions,
    controller: ControllerOption = None,
    rate: RateOption = 1.0,
    surface: SurfaceOption = "model",
    unchecked: UncheckedOption = False,
    laps: Annotated[
        int,
        typer.Option(
            metavar="N", help="Follow a closed path N times without stopping; `adaptive` learns."
        ),
    ] = 1,
    with_open: Annotated[
        bool | None,
        typer.Option(
            "--with-open/--no-open",
            help="Also run the open loop for comparison; by default if the robot is simulated.",
        ),
    ] = None,
    view: ViewOption = None,
    publish: PublishOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Follow a path and show the tracking error.

    Example: ccr-host track 8shape --set twin.payload_g=5
    """
    from ccr_host.commands import terminal
    from ccr_host.control.registry import DEFAULT_CONTROLLER
    from ccr_host.record.folder import ResultFolder
    from ccr_host.record.keep import execute_logged, keep_result
    from ccr_host.run.campaign import in_background
    from ccr_host.run.execute import reference_of
    from ccr_host.run.open_rig import is_simulated

    controller = controller or DEFAULT_CONTROLLER
    with ExitStack() as stack:
        options = RunOptions(
            **vars(rig),
            path=path,
            controller=controller,
            rate_hz=rate,
            laps=laps,
            checks="none" if unchecked else "motion",
            surface=surface,
        )
        print_notes([options])
        reference = reference_of(options)
        folder = stack.enter_context(ResultFolder(out, f"{reference.name}-{controller}"))
        screen = console_beside(as_json=as_json)
        page = None
        if view is not None:
            from ccr_host.view.live import live_page, parse_view_address

            address, realtime = parse_view_address(view), not is_simulated(options)
            page = stack.enter_context(live_page(address, realtime=realtime))
            console(on_stderr=True).print(f"live page: {page.url}", soft_wrap=True)
        watchers: list[RunObserver] = [page.feed] if page else []
        if publish is not None:
            from ccr_host.run.igtl_server import published

            server = stack.enter_context(published(publish))
            console(on_stderr=True).print(f"OpenIGTLink server: igtl://{server.address}")
            watchers.append(server.observer)
        wanted = is_simulated(options) if with_open is None else with_open
        wanted = wanted and controller != "open-loop"
        twin_open_loop = options.with_controller("open-loop").on_the_twin()
        with in_background(twin_open_loop) if wanted else nullcontext() as open_loop_result:
            title = f"{reference.name}, {controller}"
            with terminal.step_progress(title) as progress:
                result = execute_logged(
                    options,
                    folder.path,
                    progress.on_step,
                    [progress, *watchers],
                    page.operator if page else None,
                )
            kept = keep_result(folder, result, open_loop_result)
        if page:
            page.end_run(folder.path)
        _show(result, kept.summary, screen)
        tell_kept(screen, folder, result.log_trouble, kept.no_open_loop)
        if as_json:
            print_json(kept.summary)
        elif page and screen.is_terminal:
            screen.print(f"the run can be replayed at {page.url}; Ctrl-C ends")
            page.wait_until_interrupted()
        if kept.failure is not None:
            raise kept.failure


def _show(result: RunResult, summary: Mapping[str, Any], screen: Console) -> None:
    from ccr_host.commands import terminal
    from ccr_host.run.rig import OperatorStop

    if result.records:
        screen.print(terminal.run_table(summary, result.options))
        for line in terminal.remarks([result]):
            screen.print(line)
        for line in terminal.health_lines(summary):
            screen.print(line)
    if isinstance(result.failure, OperatorStop):
        console(on_stderr=True).print(f"{result.failure}; acknowledged by the board")
