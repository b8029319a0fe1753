"""The command ``ccr-host monitor``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.commands.options import (
    JsonOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
    console,
    print_json,
)
from ccr_host.core.standard_streams import is_output_lost

if TYPE_CHECKING:
    from ccr_host.tools.monitor import Monitor, MonitorView

_REFRESH_US = 200_000
_LINE_US = 1_000_000


def _not_nan(seconds: float | None) -> float | None:
    """Reject nan, which passes the bounds."""
    if seconds is not None and math.isnan(seconds):
        raise typer.BadParameter("nan is not a number")
    return seconds


def monitor(
    tracker: TrackerOption = "twin:",
    device: Annotated[
        str | None,
        typer.Option(metavar="URI", help="Also monitor a board."),
    ] = None,
    robot: RobotOption = None,
    overrides: SetOption = None,
    seed: SeedOption = 1,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=0.1,
            max=1e6,
            callback=_not_nan,
            help="End after this time; otherwise with Ctrl-C.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show live marker positions, rates, ages and losses. Nothing moves.

    With --json one line per second, or with --duration one object at the end.

    Example: ccr-host monitor --tracker ndi:/dev/ttyUSB0
    """
    from ccr_host.core.errors import TrackerError
    from ccr_host.description import schema
    from ccr_host.tools.monitor import open_monitor

    description = schema.load(robot, overrides or ())
    last: MonitorView | None = None
    with (
        open_monitor(tracker, device, description, seed) as opened,
        suppress(KeyboardInterrupt),
    ):
        if as_json:
            for last in _snapshots(opened, duration, _LINE_US):
                if duration is None:
                    print_json(last.summary())
                    if is_output_lost():
                        break
        else:
            last = _show(opened, duration)
    if last is None:
        return
    if as_json and duration is not None:
        print_json(last.summary())
    if last.sample is None:
        raise TrackerError(
            f"{tracker}: no sample" + (f": {last.trouble}" if last.trouble else ""),
            "check line of sight, measurement volume and markers",
        )


def _snapshots(opened: Monitor, duration_s: float | None, period_us: int) -> Iterator[MonitorView]:
    """Yield snapshots every ``period_us``, the last one at the end."""
    left_us = None if duration_s is None else round(duration_s * 1e6)
    while left_us is None or left_us > 0:
        step_us = period_us if left_us is None else min(period_us, left_us)
        yield opened.watch(step_us)
        left_us = None if left_us is None else left_us - step_us


def _show(opened: Monitor, duration_s: float | None) -> MonitorView | None:
    from rich.live import Live

    from ccr_host.commands.tracker_screen import monitor_panel

    last: MonitorView | None = None
    with Live(console=console(), auto_refresh=False) as live, suppress(KeyboardInterrupt):
        for last in _snapshots(opened, duration_s, _REFRESH_US):
            live.update(monitor_panel(last), refresh=True)
    return last
