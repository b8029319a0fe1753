"""What people read in the terminal: progress and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from ccr_host.run.paper_results import PAPER_RESULTS
from ccr_host.run.step_record import StepRecord
from ccr_host.run.summary import ratio_to_twin_floor

OnStep = Callable[[int, int, StepRecord], None]


class OnCount(Protocol):
    """Told how many more pieces of work are done."""

    def __call__(self, pieces: int = 1) -> None: ...


@contextmanager
def step_progress(console: Console, title: str) -> Iterator[OnStep]:
    """Progress bar over control steps, with the error of the last one."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}", markup=False),
        TimeRemainingColumn(),
    )
    with _progress(console, *columns) as progress:
        task = progress.add_task(title, total=None, state="arming")

        def on_step(step: int, steps: int, record: StepRecord) -> None:
            progress.update(task, total=steps, completed=step + 1, state=_error_text(record))

        yield on_step


@contextmanager
def count_progress(console: Console, title: str, total: int) -> Iterator[OnCount]:
    """Progress bar over equal pieces of work; the function takes how many are done, one if not."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with _progress(console, *columns, TimeRemainingColumn()) as progress:
        task = progress.add_task(title, total=total)

        def count(pieces: int = 1) -> None:
            progress.advance(task, pieces)

        yield count


@contextmanager
def steps_progress(console: Console, title: str) -> Iterator[Callable[[int, int], None]]:
    """Progress bar over steps whose number is told while they are done."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with _progress(console, *columns) as progress:
        task = progress.add_task(title, total=None)

        def on_step(done: int, steps: int) -> None:
            progress.update(task, total=steps, completed=done)

        yield on_step


def run_table(summary: Mapping[str, Any]) -> Table:
    """One run beside the paper's."""
    table = Table(title=f"{summary['path']} with {summary['controller']}", title_justify="left")
    table.add_column("mean of |f_m - f| (mm)")
    table.add_column("this run", justify="right")
    table.add_column("paper", justify="right")
    paper = PAPER_RESULTS.get(summary["path"])
    open_loop = summary["open"]
    paper_open, paper_mpc = (paper.open_loop_mm, paper.mpc_mm) if paper else (None, None)
    is_open_loop = summary["controller"] == "open-loop"
    if open_loop is not None:
        table.add_row("open loop", _mm(open_loop["mean_error_mm"]), _mm(paper_open))
    table.add_row(
        str(summary["controller"]),
        _mm(summary["mean_error_mm"]),
        _mm(paper_open if is_open_loop else paper_mpc),
    )
    if "true_mean_error_mm" in summary:
        table.add_row("  of the true position", _mm(summary["true_mean_error_mm"]), "")
        floor_mm = summary["twin_floor_mean_error_mm"]
        table.add_row("  floor: least of any motor path", _mm(floor_mm), "")
        table.add_row("  ratio of these two", _ratio(ratio_to_twin_floor(summary)), "")
    for number, lap in enumerate(summary["laps"] or (), start=1):
        lap_mm = lap.get("true_mean_error_mm", lap["mean_error_mm"])
        table.add_row(f"  lap {number}", _mm(lap_mm), "")
    table.add_row("  95 % of the steps below", _mm(summary["p95_error_mm"]), "")
    table.add_row("  greatest", _mm(summary["max_error_mm"]), "")
    unreachable = summary["unreachable_steps"]
    note = f" ({unreachable} of {summary['steps']} points out of reach)" if unreachable else ""
    table.add_row(f"  unavoidable by the model{note}", _mm(summary["floor_mean_error_mm"]), "")
    return table


def health_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Link, solver and tracker in a few words; what went wrong is named."""
    link, solve = summary["link"], summary["solve_us"]
    rtt = link["rtt_us_median"]
    round_trip = f", round trip {rtt / 1000:.1f} ms" if rtt is not None else ""
    yield (
        f"link: {link['sent']} frames sent, {link['received']} received, "
        f"{link['crc_errors']} CRC errors, {link['retries']} retries{round_trip}"
    )
    if solve["median"] is not None:
        median, p99 = solve["median"], solve["p99"]
        yield f"controller: median {median:.0f} us a step, 99 % below {p99:.0f} us"
    if summary["missed_deadlines"]:
        yield f"missed deadlines: {summary['missed_deadlines']}"
    if summary["tracker_lost_steps"]:
        yield (
            f"steps without a fresh tracker sample: {summary['tracker_lost_steps']}; commands from "
            f"the model alone: {summary['coasted_steps']}, pose held: {summary['held_steps']}"
        )


def comparison_table(summaries: Sequence[Mapping[str, Any]]) -> Table:
    """The paper's results, path by path, beside ours."""
    table = Table(
        title="|f_m - f| (mm)",
        title_justify="left",
        caption=(
            "here, paper, true (position): means; "
            "floor: the least that any motor path reaches on the twin; ratio: true over floor"
        ),
        caption_justify="left",
    )
    for heading in ("path", "controller"):
        table.add_column(heading, no_wrap=True)
    for heading in ("here", "paper", "true", "floor", "ratio", "p95", "max"):
        table.add_column(heading, justify="right")
    previous = None
    for summary in summaries:
        path, controller = summary["path"], summary["controller"]
        table.add_row(
            path if path != previous else "",
            controller,
            _mm(summary["mean_error_mm"]),
            _mm(_paper_figure(path, controller)),
            _mm(summary.get("true_mean_error_mm")),
            _mm(summary["twin_floor_mean_error_mm"]),
            _ratio(ratio_to_twin_floor(summary)),
            _mm(summary["p95_error_mm"]),
            _mm(summary["max_error_mm"]),
        )
        previous = path
    return table


def sweep_table(groups: Sequence[Mapping[str, Any]]) -> Table:
    """Distributions over random twins, a row for each controller and rate."""
    table = Table(
        title="mean true error over the floor of the same twin",
        title_justify="left",
        box=box.SIMPLE,
        collapse_padding=True,
        pad_edge=False,
        caption="excess: median above the floor (mm); limits: left them; early: ended by a fault",
        caption_justify="left",
    )
    table.add_column("Hz", justify="right")
    table.add_column("controller", no_wrap=True)
    headings = ("runs", "median", "p95", "worst", "excess", "diverged", "limits", "early")
    for heading in headings:
        table.add_column(heading, justify="right")
    for group in groups:
        ratio = group["ratio"]
        table.add_row(
            f"{group['rate_hz']:g}",
            group["controller"],
            str(group["runs"]),
            *(_ratio(ratio[name]) for name in ("median", "p95", "max")),
            _mm(group["excess_mm"]["median"]),
            *(str(group[name]) for name in ("diverged", "outside_limits", "ended_early")),
        )
    return table


def worst_lines(groups: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The worst twins of each controller and rate."""
    for group in groups:
        worst = ", ".join(f"{run['index']} ({_reached(run)})" for run in group["worst"])
        yield f"worst twins of {group['controller']} at {group['rate_hz']:g} Hz: {worst}"


def _reached(run: Mapping[str, Any]) -> str:
    ratio = f"ratio {_ratio(run['ratio'])}"
    return str(run["fault"]) or (f"{ratio}, diverged" if run["diverged"] else ratio)


def reach_table(reach: Mapping[str, Any]) -> Table:
    """What of a path is out of reach."""
    table = Table(title=f"reach of {reach['path']}", title_justify="left", show_header=False)
    table.add_row("points", str(reach["steps"]))
    table.add_row("out of reach", str(reach["unreachable_steps"]))
    table.add_row("mean unavoidable error (mm)", _mm(reach["floor_mean_error_mm"]))
    table.add_row("greatest unavoidable error (mm)", _mm(reach["floor_max_error_mm"]))
    table.add_row("  at time (s)", f"{reach['floor_max_at_s']:g}")
    for axis in (0, 1):
        low, high = reach["motor_range_deg"][axis]
        table.add_row(f"motor {axis + 1} (deg)", f"{low:.1f} .. {high:.1f}")
        table.add_row("  greatest step (deg)", f"{reach['motor_step_max_deg'][axis]:.1f}")
    return table


def _progress(console: Console, *columns: ProgressColumn) -> Progress:
    """Shown on terminals only, and gone at the end."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _paper_figure(path: str, controller: str) -> float | None:
    paper = PAPER_RESULTS.get(path)
    if paper is None:
        return None
    return {"open-loop": paper.open_loop_mm, "mpc": paper.mpc_mm}.get(controller)


def _error_text(record: StepRecord) -> str:
    if record.measured_mm is None:
        return "markers lost"
    return f"error {np.linalg.norm(record.measured_mm - record.target_mm):5.1f} mm"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
