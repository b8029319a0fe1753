"""Figures of a report, as SVG to stand in a page."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.run.figure import run_figure
from ccr_host.run.report.recorded_run import RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOTORS = ("#2166ac", "#b35806")
_LIMIT = "#b2182b"


def path_svg(run: RecordedRun) -> str:
    """Desired and measured path, and the error over time."""
    return _svg(run_figure(run.setup.reference, [(run.setup.options.controller, run.records)]))


def health_svg(run: RecordedRun) -> str:
    """Motor angles against their limits, computing time and age of the samples."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    figure = Figure(figsize=(11, 7), layout="constrained")
    motors, solve, age = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
    time_s = [record.time_s for record in run.records]
    _draw_motors(motors, run, time_s)
    solve.plot(time_s, [record.solve_us / 1000 for record in run.records], color=_MOTORS[0])
    solve.set_ylabel("computing (ms)")
    ages_ms = [
        np.nan if r.measured_age_us is None else r.measured_age_us / 1e3 for r in run.records
    ]
    age.plot(time_s, ages_ms, color=_MOTORS[0])
    age.set_ylabel("sample's age (ms)")
    age.set_xlabel("time (s)")
    for axes in (solve, age):
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    return _svg(figure)


def _draw_motors(axes: Axes, run: RecordedRun, time_s: list[float]) -> None:
    angles_deg = np.degrees([record.q_rad for record in run.records])
    servo = run.setup.description.servo
    for axis, colour in enumerate(_MOTORS):
        axes.plot(time_s, angles_deg[:, axis], color=colour, label=f"motor {axis + 1}")
        for limit in (servo.angle_min_deg[axis], servo.angle_max_deg[axis]):
            axes.axhline(limit, color=_LIMIT, lw=0.8, ls=":")
    axes.set_ylabel("command (deg), limits dotted")
    axes.legend(loc="upper right")
    axes.grid(alpha=0.3)


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg")
    whole = text.getvalue()
    return whole[whole.index("<svg") :]
