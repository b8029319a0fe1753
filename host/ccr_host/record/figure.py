"""The figures of runs, arranged as in the paper's Figs. 8 and 9."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.control.open_loop import OpenLoop
from ccr_host.core.arrays import Array
from ccr_host.record.comparisons import paper_mean_mm
from ccr_host.record.figure_style import (
    BESIDE_THE_TRUTH,
    DESIRED,
    LOST,
    UNREACHABLE,
    controller_colours,
    plain,
    save_figure,
)
from ccr_host.robot.reference import PATH_AXES, Reference
from ccr_host.robot.workspace import Workspace
from ccr_host.run.observer import StepRecord, measured_errors_mm, true_errors_mm
from ccr_host.run.options import RunOptions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LABELS = {"x": "x, along the robot (mm)", "y": "y (mm)", "z": "z (mm)"}
_MOST_MARKERS = 200
"""Lines with more points than this are drawn without markers."""
_SHADE = 0.3
_DASHES = ("-", "--", ":", "-.")
"""Line styles of several runs of one controller."""
_ERROR = "tip error (mm)"


@dataclass(frozen=True)
class PlottedRun:
    """A run as the figures show it."""

    options: RunOptions
    reference: Reference
    records: Sequence[StepRecord]
    label: str = ""
    """Empty: the controller's name."""

    @property
    def name(self) -> str:
        """Name in the legend."""
        return plain(self.label or self.options.controller)


def write_run_figure(file: Path, runs: Sequence[PlottedRun]) -> None:
    """Write ``run_figure`` as PNG, PDF and SVG."""
    save_figure(run_figure(runs), file)


def run_figure(runs: Sequence[PlottedRun]) -> Figure:
    """Desired, measured and true path in its planes and the error over time.

    The runs are on the same path, the one that matters first.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - costs 0.7 s, spent while twins run

    planes = _planes(runs[0].reference)
    figure = Figure(figsize=(5.5 * len(planes), 8.2), layout="constrained")
    grid = figure.add_gridspec(2, len(planes), height_ratios=(1.7, 1))
    for column, plane in enumerate(planes):
        _draw_plane(figure.add_subplot(grid[0, column]), runs, plane)
    _draw_error(figure.add_subplot(grid[1, :]), runs)
    _draw_legend(figure, runs)
    steps = {f", {len(r)} steps of {r.period_s:g} s" for r in (run.reference for run in runs)}
    figure.suptitle(plain(runs[0].reference.name) + (steps.pop() if len(steps) == 1 else ""))
    return figure


def write_comparison_figure(file: Path, groups: Sequence[Sequence[PlottedRun]]) -> None:
    """Draw several controllers on several paths: a column for each path.

    Paths in space have a second plane, with the coordinate along the robot. ``file`` is the PNG;
    PDF and SVG come beside it.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above

    planes = ("yz", "xz") if any(runs[0].reference.in_space for runs in groups) else ("yz",)
    figure = Figure(figsize=(4.6 * len(groups) + 2, 2.8 + 4.6 * len(planes)), layout="constrained")
    grid = figure.add_gridspec(
        len(planes) + 1, len(groups), height_ratios=(*(1.6 for _ in planes), 1)
    )
    for column, runs in enumerate(groups):
        for row, plane in enumerate(planes):
            axes = figure.add_subplot(grid[row, column])
            _draw_plane(axes, runs, plane)
            if row == 0:
                axes.set_title(plain(runs[0].reference.name))
        _draw_error(figure.add_subplot(grid[-1, column]), runs)
    _draw_legend(figure, [run for runs in groups for run in runs])
    save_figure(figure, file)


def write_workspace_figure(file: Path, reference: Reference, workspace: Workspace) -> None:
    """Draw a path over the region that the robot reaches.

    ``file`` is the PNG; PDF and SVG come beside it.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above

    planes = _planes(reference)
    figure = Figure(figsize=(6 * len(planes), 6), layout="constrained")
    rim = workspace.boundary_mm()
    nearest = workspace.model.tip_mm(reference.q_rad)
    for axes, plane in zip(figure.subplots(1, len(planes)), planes, strict=True):
        if plane == "yz":
            axes.fill(*_in_plane(rim, plane), color="#dddddd", label="within reach")
        _draw_desired(axes, reference, plane)
        _finish_plane(axes, plane)
        style = "." if len(nearest) <= _MOST_MARKERS else "-"
        axes.plot(*_in_plane(nearest, plane), style, color="black", ms=4, label="nearest reachable")
    _draw_legend(figure)
    figure.suptitle(f"{plain(reference.name)}: reach of {_motors(reference)}")
    save_figure(figure, file)


def shade_lost_spans(
    axes: Axes, run: PlottedRun, colour: str = LOST, label: str = "markers lost"
) -> None:
    """Shade where the tip was not measured, over the path's clock."""
    period_s = run.reference.period_s
    for is_lost, records in groupby(run.records, key=lambda record: record.measured_mm is None):
        if is_lost:
            times_s = [record.time_s for record in records]
            start_s, end_s = times_s[0] - period_s / 2, times_s[-1] + period_s / 2
            axes.axvspan(start_s, end_s, color=colour, alpha=_SHADE, lw=0, label=label)


def _planes(reference: Reference) -> tuple[str, ...]:
    """Axes across and upwards of each view of a path; a path in space has a third view."""
    return ("yz", "xz", "yx") if reference.in_space else ("yz", "xz")


def _in_plane(points_mm: Array, plane: str) -> tuple[Array, Array]:
    across, upwards = (points_mm[:, PATH_AXES[axis]] for axis in plane)
    return across, upwards


def _draw_plane(axes: Axes, runs: Sequence[PlottedRun], plane: str) -> None:
    drawn: list[Array] = []
    for run in runs:
        if not any(np.array_equal(run.reference.target_mm, other) for other in drawn):
            drawn.append(run.reference.target_mm)
            _draw_desired(axes, run.reference, plane)
    for run, colour, dash in _styled(runs):
        measured, truth = _paths(run)
        markers = len(measured) <= _MOST_MARKERS
        axes.plot(
            *_in_plane(measured, plane),
            ls=dash,
            marker="." if markers else "",
            color=colour,
            alpha=1.0 if truth is None else BESIDE_THE_TRUTH,
            lw=1,
            ms=4,
        )
        if truth is not None:
            axes.plot(*_in_plane(truth, plane), ls=dash, color=colour, lw=1.3)
    _finish_plane(axes, plane)


def _draw_desired(axes: Axes, reference: Reference, plane: str) -> None:
    target = reference.target_mm
    axes.plot(*_in_plane(target, plane), "--", color=DESIRED, label="desired")
    if reference.unreachable_steps:
        out = np.where(reference.reachable[:, None], np.nan, target)
        style = "x" if len(target) <= _MOST_MARKERS else "-"
        axes.plot(
            *_in_plane(out, plane), style, color=UNREACHABLE, ms=5, label="desired, out of reach"
        )


def _finish_plane(axes: Axes, plane: str) -> None:
    axes.set_xlabel(_LABELS[plane[0]])
    axes.set_ylabel(_LABELS[plane[1]])
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)


def _draw_error(axes: Axes, runs: Sequence[PlottedRun]) -> None:
    for run, colour, dash in _styled(runs):
        time_s = [record.time_s for record in run.records]
        measured, truth = measured_errors_mm(run.records), true_errors_mm(run.records)
        alpha = 1.0 if truth is None else BESIDE_THE_TRUTH
        axes.plot(time_s, np.linalg.norm(measured, axis=1), ls=dash, color=colour, alpha=alpha)
        if truth is not None:
            axes.plot(time_s, np.linalg.norm(truth, axis=1), ls=dash, color=colour)
    # What the open loop does not see changes nothing for it.
    seeing = [run for run in runs if run.options.controller != OpenLoop.name] or runs
    for run, colour, _ in _styled(seeing):
        if len(seeing) == 1:
            shade_lost_spans(axes, run)
        else:
            shade_lost_spans(axes, run, colour, f"{run.name}: markers lost")
    longest = max((run.reference for run in runs), key=lambda reference: reference.time_s[-1])
    if longest.unreachable_steps:
        axes.fill_between(
            longest.time_s,
            longest.unavoidable_mm,
            color=UNREACHABLE,
            alpha=0.3,
            lw=0,
            label=f"unavoidable for {_motors(longest)}",
        )
    _draw_papers_means(axes, runs)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(_ERROR)
    axes.set_ylim(bottom=0)
    axes.set_xlim(0, longest.time_s[-1] or longest.period_s)
    axes.grid(alpha=0.3)


def _motors(reference: Reference) -> str:
    motors = reference.q_rad.shape[1]
    return {1: "one motor", 2: "two motors"}.get(motors, f"{motors} motors")


def _draw_papers_means(axes: Axes, runs: Sequence[PlottedRun]) -> None:
    styles = {"mpc": ":", "open-loop": "-."}
    for controller, style in styles.items():
        means = {paper_mean_mm(r.options) for r in runs if r.options.controller == controller}
        label = f"paper's robot, mean of {controller}"
        for mean_mm in means:
            if mean_mm is not None:
                axes.axhline(mean_mm, color="black", lw=0.8, ls=style, label=label)


def _draw_legend(figure: Figure, runs: Sequence[PlottedRun] = ()) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - as above

    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    for run, colour, dash in _styled(runs):
        entries.setdefault(run.name, Line2D([], [], color=colour, ls=dash))
    if any(true_errors_mm(run.records) is not None for run in runs):
        entries["pale: measured"] = Line2D([], [], color="black", alpha=BESIDE_THE_TRUTH, lw=1)
        entries["full: true tip of the simulated robot"] = Line2D([], [], color="black")
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=4, frameon=False
    )


def _styled(runs: Sequence[PlottedRun]) -> Iterator[tuple[PlottedRun, str, str]]:
    """Yield each run with its controller's colour and a dash that tells its runs apart."""
    colours = controller_colours(run.options.controller for run in runs)
    seen: Counter[str] = Counter()
    for run in runs:
        controller = run.options.controller
        yield run, colours[controller], _DASHES[seen[controller] % len(_DASHES)]
        seen[controller] += 1


def _paths(run: PlottedRun) -> tuple[Array, Array | None]:
    """Measured and true tip at the end of each step, (N, 3) in mm; no truth of a real robot."""
    targets = np.array([record.target_mm for record in run.records]).reshape(-1, 3)
    truth = true_errors_mm(run.records)
    measured: Array = targets + measured_errors_mm(run.records)
    return measured, None if truth is None else targets + truth
