"""What people read in the terminal: progress and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ccr_host.run.paper_results import PAPER_RESULTS
from ccr_host.run.step_record import StepRecord

OnStep = Callable[[int, int, StepRecord], None]


@contextmanager
def step_progress(console: Console, title: str) -> Iterator[OnStep]:
    """Progress bar over control steps, with the error of the last one."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=None, state="arming")

        def on_step(step: int, steps: int, record: StepRecord) -> None:
            progress.update(task, total=steps, completed=step + 1, state=_error_text(record))

        yield on_step


@contextmanager
def count_progress(console: Console, title: str, total: int) -> Iterator[Callable[[], None]]:
    """Progress bar over equal pieces of work."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda: progress.advance(task)


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
        yield f"steps without a fresh tracker sample: {summary['tracker_lost_steps']}"


def comparison_table(summaries: Sequence[Mapping[str, Any]]) -> Table:
    """The paper's results, path by path, beside ours."""
    table = Table(
        title="|f_m - f| (mm)",
        title_justify="left",
        caption="here, paper, true (position): means; floor: unavoidable, by the model",
        caption_justify="left",
    )
    for heading in ("path", "controller"):
        table.add_column(heading, no_wrap=True)
    for heading in ("here", "paper", "true", "p95", "max", "floor"):
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
            _mm(summary["p95_error_mm"]),
            _mm(summary["max_error_mm"]),
            _mm(summary["floor_mean_error_mm"]),
        )
        previous = path
    return table


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
