"""Figures of a report, as SVG to stand in a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.run.figure import PlottedRun, run_figure, shade_lost_spans
from ccr_host.run.figure_style import LIMIT, MOTORS, svg_element
from ccr_host.run.report.recorded_run import RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def overlay_svgs(runs: Sequence[RecordedRun], names: Sequence[str]) -> Iterator[str]:
    """All runs on one path in one figure, for each path that has several; a name for each run."""
    on_paths: dict[str, list[PlottedRun]] = {}
    for run, name in zip(runs, names, strict=True):
        if run.records:
            on_paths.setdefault(run.setup.reference.name, []).append(_plotted(run, name))
    for together in on_paths.values():
        if len(together) > 1:
            yield svg_element(run_figure(together))


def path_svg(run: RecordedRun) -> str:
    """Desired, measured and true path, and the error over time."""
    return svg_element(run_figure([_plotted(run)]))


def health_svg(run: RecordedRun) -> str:
    """Motor angles against their limits, computing time and age of the samples."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    figure = Figure(figsize=(11, 7), layout="constrained")
    motors, solve, age = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    time_s = [record.time_s for record in run.records]
    _draw_motors(motors, run, time_s)
    solve.plot(time_s, [record.solve_us / 1000 for record in run.records], color=MOTORS[0])
    solve.set_ylabel("computing time (ms)")
    ages_ms = [
        np.nan if r.measured_age_us is None else r.measured_age_us / 1e3 for r in run.records
    ]
    age.plot(time_s, ages_ms, color=MOTORS[0])
    age.set_ylabel("age of the sample (ms)")
    age.set_xlabel("time (s)")
    for axes in (solve, age):
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    shade_lost_spans(age, _plotted(run))
    return svg_element(figure)


def _draw_motors(axes: Axes, run: RecordedRun, time_s: list[float]) -> None:
    angles_deg = np.degrees([record.q_rad for record in run.records])
    servo = run.setup.description.servo
    for axis, colour in enumerate(MOTORS):
        axes.plot(time_s, angles_deg[:, axis], color=colour, label=f"motor {axis + 1}")
        for limit in (servo.angle_min_deg[axis], servo.angle_max_deg[axis]):
            axes.axhline(limit, color=LIMIT, lw=0.8, ls=":")
    axes.set_ylabel("command (deg), limits dotted")
    axes.legend(loc="upper right")
    axes.grid(alpha=0.3)


def _plotted(run: RecordedRun, label: str = "") -> PlottedRun:
    return PlottedRun(run.setup.options, run.setup.reference, run.records, label)
