"""The figure of a run, arranged as in the paper's Figs. 8 and 9."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.control.open_loop import OpenLoop
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import Workspace
from ccr_host.run.paper_results import PAPER_RESULTS
from ccr_host.run.step_record import StepRecord, Vector, measured_errors_mm

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PATH = "#999999"
_UNREACHABLE = "#d95f02"
_OPEN_LOOP = "#2166ac"
_CLOSED_LOOP = ("#1b7837", "#762a83", "#b35806", "#c51b7d", "#4d9221", "#01665e")
X, Y, Z = 1, 0, 2
"""Components of f that the trajectories call x (along the robot), y and z."""

LabelledRun = tuple[str, Sequence[StepRecord]]


def write_run_figure(file: Path, reference: Reference, runs: Sequence[LabelledRun]) -> None:
    """Write ``run_figure`` as PNG."""
    run_figure(reference, runs).savefig(file, dpi=110)


def run_figure(reference: Reference, runs: Sequence[LabelledRun]) -> Figure:
    """Desired and measured path in both planes and the error norm over time.

    Args:
        reference: the desired path.
        runs: label and records of each run on it, the one that matters first.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - costs 0.7 s, spent while twins run

    figure = Figure(figsize=(11, 8.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.7, 1))
    _draw_plane(figure.add_subplot(grid[0, 0]), reference, runs, Y, "y (mm)")
    _draw_plane(figure.add_subplot(grid[0, 1]), reference, runs, X, "x, along the robot (mm)")
    _draw_error(figure.add_subplot(grid[1, :]), reference, runs)
    _draw_legend(figure)
    figure.suptitle(f"{reference.name}, {len(reference.time_s)} steps of {reference.period_s:g} s")
    return figure


def write_comparison_figure(
    file: Path, groups: Sequence[tuple[Reference, Sequence[LabelledRun]]]
) -> None:
    """Draw several controllers on several paths: a column for each path.

    Args:
        file: PNG to write.
        groups: each path with its runs; the same labels in the same order for each.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above

    figure = Figure(figsize=(4.6 * len(groups) + 2, 7.4), layout="constrained")
    grid = figure.add_gridspec(2, len(groups), height_ratios=(1.6, 1))
    for column, (reference, runs) in enumerate(groups):
        plane = figure.add_subplot(grid[0, column])
        _draw_plane(plane, reference, runs, Y, "y (mm)")
        plane.set_title(reference.name)
        _draw_error(figure.add_subplot(grid[1, column]), reference, runs)
    _draw_legend(figure)
    figure.savefig(file, dpi=110)


def write_workspace_figure(file: Path, reference: Reference, workspace: Workspace) -> None:
    """Draw a path over the region that two motors reach.

    Args:
        file: PNG to write.
        reference: the path.
        workspace: of the robot.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above

    figure = Figure(figsize=(12, 6), layout="constrained")
    rim = workspace.boundary_mm()
    nearest = workspace.model.tip_mm(reference.q_rad)
    for position, across, label in ((121, Y, "y (mm)"), (122, X, "x, along the robot (mm)")):
        axes = figure.add_subplot(position)
        if across == Y:
            axes.fill(rim[:, across], rim[:, Z], color="#dddddd", label="within reach")
        _draw_plane(axes, reference, [], across, label)
        axes.plot(
            nearest[:, across], nearest[:, Z], ".", color=_CLOSED_LOOP[0], label="nearest reachable"
        )
    _draw_legend(figure)
    figure.suptitle(f"{reference.name}: reach of two motors")
    figure.savefig(file, dpi=110)


def _draw_plane(
    axes: Axes, reference: Reference, runs: Sequence[LabelledRun], across: int, label: str
) -> None:
    target = reference.target_mm
    axes.plot(target[:, across], target[:, Z], "--", color=_PATH, label="desired")
    out = ~reference.reachable
    if out.any():
        axes.plot(
            target[out, across],
            target[out, Z],
            "x",
            color=_UNREACHABLE,
            markersize=5,
            label="desired, out of reach",
        )
    for (name, records), colour in zip(runs, _colours(runs), strict=True):
        path = _measured(records)
        axes.plot(path[:, across], path[:, Z], ".-", color=colour, lw=1, ms=4, label=name)
    axes.set_xlabel(label)
    axes.set_ylabel("z (mm)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)


def _draw_error(axes: Axes, reference: Reference, runs: Sequence[LabelledRun]) -> None:
    time_s = reference.time_s
    for (_, records), colour in zip(runs, _colours(runs), strict=True):
        norms = np.linalg.norm(measured_errors_mm(records), axis=1)
        axes.plot(time_s[: len(norms)], norms, color=colour)
    if not reference.reachable.all():
        axes.fill_between(
            time_s,
            reference.unavoidable_mm,
            color=_UNREACHABLE,
            alpha=0.3,
            lw=0,
            label="unavoidable for two motors",
        )
    paper = PAPER_RESULTS.get(reference.name)
    if paper is not None:
        axes.axhline(paper.mpc_mm, color="black", lw=0.8, ls=":", label="paper, mean of MPC")
        axes.axhline(
            paper.open_loop_mm, color="black", lw=0.8, ls="-.", label="paper, mean of open loop"
        )
    axes.set_xlabel("time (s)")
    axes.set_ylabel("|f_m - f| (mm)")
    axes.set_ylim(bottom=0)
    axes.set_xlim(time_s[0], time_s[-1])
    axes.grid(alpha=0.3)


def _draw_legend(figure: Figure) -> None:
    entries: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=4, frameon=False
    )


def _colours(runs: Sequence[LabelledRun]) -> list[str]:
    closed = cycle(_CLOSED_LOOP)
    return [_OPEN_LOOP if name == OpenLoop.name else next(closed) for name, _ in runs]


def _measured(records: Sequence[StepRecord]) -> Vector:
    unknown = np.full(3, np.nan)
    return np.array([unknown if r.measured_mm is None else r.measured_mm for r in records])
