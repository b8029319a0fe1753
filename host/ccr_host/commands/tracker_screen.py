"""Terminal output about trackers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ccr_host.robot.reference import PATH_AXES
from ccr_host.tools.monitor import LinkView, MonitorView
from ccr_host.tools.survey_fit import Survey


def registration_table(found: Survey) -> Table:
    """The camera's orientation and its uncertainty."""
    table = Table(title="registration", title_justify="left", show_header=False)
    turned, uncertain = found.camera_to_robot_deg, found.uncertainty_deg
    table.add_row("camera to robot, rotation vector (deg)", _numbers(turned, 2))
    table.add_row("uncertainty about x, y, z (deg)", _numbers(uncertain, 2))
    table.add_row("residual (mm)", f"{found.residual_mm:.2f}")
    motors = ", ".join(str(motor + 1) for motor in range(len(found.direction)))
    tip = f"M{len(found.lengths_mm) + 1}"
    hysteresis = _numbers(found.hysteresis_mm, 2)
    table.add_row(f"hysteresis of {tip} by motor {motors} (+- mm)", hysteresis)
    table.add_row("segments as measured (mm)", _numbers(found.lengths_mm, 1))
    if found.reversed_motors:
        motors = " and ".join(map(str, found.reversed_motors))
        table.add_row("reversed", f"motor {motors}; ccr-host calibrate corrects this")
    return table


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


def _numbers(values: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]], n: int) -> str:
    return ", ".join(f"{float(value):.{n}f}" for value in values)
