"""The command ``ccr-host monitor``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ccr_host.commands.options import (
    JsonOption,
    Without,
    console,
    print_json,
)
from ccr_host.core.standard_streams import is_output_lost
from ccr_host.robot.reference import PATH_AXES
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from ccr_host.tools.monitor import LinkView, Monitor, MonitorView

_REFRESH_US = 200_000
_LINE_US = 1_000_000


def _not_nan(seconds: float | None) -> float | None:
    """Reject nan, which passes the bounds."""
    if seconds is not None and math.isnan(seconds):
        raise typer.BadParameter("nan is not a number")
    return seconds


def monitor(
    rig: Annotated[RigOptions, Without("device", "plant", "realtime")],
    device: Annotated[
        str | None,
        typer.Option(metavar="URI", help="Also monitor a board."),
    ] = None,
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
    from ccr_host.tools.monitor import open_monitor

    last: MonitorView | None = None
    with (
        open_monitor(rig.tracker, device, rig.description(), rig.seed) as opened,
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
            f"{rig.tracker}: no sample" + (f": {last.trouble}" if last.trouble else ""),
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

    last: MonitorView | None = None
    with Live(console=console(), auto_refresh=False) as live, suppress(KeyboardInterrupt):
        for last in _snapshots(opened, duration_s, _REFRESH_US):
            live.update(monitor_panel(last), refresh=True)
    return last


def monitor_panel(view: MonitorView) -> RenderableType:
    """Markers, figures, warnings and link."""
    parts: list[RenderableType] = [_markers(view), Text(), *_figures(view)]
    parts += [Text(f"! {warning}", style="bold red") for warning in view.health.warnings]
    if view.trouble:
        parts.append(Text(f"! {view.trouble}", style="bold red"))
    if view.link is not None:
        parts.append(_link(view.link))
    title = Text(f"{view.tracker}, {view.seconds:.0f} s")
    return Panel(Group(*parts), title=title, title_align="left")


def _markers(view: MonitorView) -> Table:
    frame = "robot frame" if view.registered else "camera frame: not registered"
    order = list(PATH_AXES.values()) if view.registered else [0, 1, 2]
    table = Table(title=f"mm, {frame}", title_justify="left")
    for heading in ("", "x", "y", "z", "length"):
        table.add_column(heading, justify="right")
    if view.sample is None:
        table.add_row("no sample yet", "", "", "", "")
        return table
    markers_mm = view.sample.markers_mm
    for number, place in enumerate(markers_mm, 1):
        lost = bool(np.isnan(place).any())
        table.add_row(
            f"M{number}", *(["-"] * 3 if lost else [f"{v:.2f}" for v in place[order]]), ""
        )
    tip = view.sample.tip_mm
    numbers = [f"{v:.2f}" for v in (*tip[order], np.linalg.norm(tip))]
    table.add_row(f"f = M{len(markers_mm)} - M1", *numbers)
    return table


def _figures(view: MonitorView) -> Iterator[Text]:
    health = view.health
    yield Text(
        f"camera: {health.state}; {health.frames} frames, {health.lost_frames} lost in transit, "
        f"{health.damaged_replies} damaged replies, {health.reconnections} reconnections"
    )
    age = "-" if view.age_ms is None else f"{view.age_ms:.0f}"
    arrival = "-" if view.arrival_age_ms is None else f"{view.arrival_age_ms:.0f}"
    yield Text(
        f"samples: {view.samples}, {view.rate_hz:.1f} Hz, age {age} ms (on arrival {arrival} ms), "
        f"{view.frames_without_tip} frames without a certain tip"
    )
    yield Text(f"this program: {100 * view.cpu_share:.1f} % of a core")
    if health.last_error:
        yield Text(f"last error: {health.last_error}")


def _link(link: LinkView) -> Text:
    supply = "" if link.supply_v is None else f", servo supply {link.supply_v:g} V"
    age = "-" if link.report_age_ms is None else f"{link.report_age_ms:.0f}"
    return Text(
        f"board on {link.device}: {link.state}, fault {link.fault}{supply}; report {age} ms old, "
        f"{link.crc_errors} CRC errors, {link.retries} retries"
    )
