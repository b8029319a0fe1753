"""Terminal output: progress bars and tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any, Protocol

import numpy as np
from rich import box
from rich.console import Group
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from ccr_host.commands.options import console
from ccr_host.control.base import Phase
from ccr_host.record.comparisons import paper_mean_mm, why_measured_differs
from ccr_host.run.observer import RunObserver, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult, ratio_to_twin_floor

_TERMS = {
    "tip error": "distance between measured and desired tip at the end of each step",
    "paper": "mean tip error of the paper's robot in the same experiment",
    "true": "tip error of the simulated robot itself, without the camera's errors",
    "floor": "smallest mean true error possible with any motion of the motors",
    "ratio": "mean true error over floor",
}
"""Terms used in the tables, and their explanations."""


class OnCount(Protocol):
    """Callback with the number of newly finished pieces of work."""

    def __call__(self, pieces: int = 1) -> None: ...


class RunProgress(RunObserver):
    """Progress bar of a run: one for each phase, then one for the steps with the current error."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress = progress
        self._title = title
        self._task = progress.add_task(title, total=None, state="starting")
        self._phase = ""

    def phase(self, time_us: int, phase: Phase) -> None:
        """Show a phase with its progress, or as indeterminate if the progress is unknown."""
        if phase.name != self._phase:
            self._phase = phase.name
            self._progress.remove_task(self._task)
            title = f"{self._title}: {phase.name}"
            self._task = self._progress.add_task(title, total=None, state="")
        if phase.done is not None:
            self._progress.update(self._task, total=1.0, completed=phase.done)

    def on_step(self, step: int, steps: int, record: StepRecord) -> None:
        state = f"{step + 1}/{steps}, {_error_text(record)}"
        self._progress.update(self._task, total=steps, completed=step + 1, state=state)


@contextmanager
def step_progress(title: str) -> Iterator[RunProgress]:
    """Progress bar of a run, to be used as its observer."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[state]}", markup=False),
        TimeRemainingColumn(),
    )
    with _progress(*columns) as progress:
        yield RunProgress(progress, title)


@contextmanager
def count_progress(total: int) -> Iterator[OnCount]:
    """Progress bar over runs; call the function with the number finished."""
    with _progress(*_counted(), TimeRemainingColumn()) as progress:
        task = progress.add_task("runs", total=total)

        def count(pieces: int = 1) -> None:
            progress.advance(task, pieces)

        yield count


@contextmanager
def pose_progress() -> Iterator[Callable[[int, int], None]]:
    """Progress bar over poses; call the function with those done and their total."""
    with _progress(*_counted()) as progress:
        task = progress.add_task("poses", total=None)

        def on_pose(done: int, poses: int) -> None:
            progress.update(task, total=poses, completed=done)

        yield on_pose


def run_table(summary: Mapping[str, Any], options: RunOptions) -> Group:
    """The tip error of one run, next to the paper's if the experiment is in the paper."""
    controller, open_loop = summary["controller"], summary["open"]
    rows = []
    if open_loop is not None:
        of_paper = paper_mean_mm(options.with_controller("open-loop"))
        rows.append(("mean, open loop", open_loop["mean_error_mm"], of_paper))
    rows += [
        (f"mean, {controller}", summary["mean_error_mm"], paper_mean_mm(options)),
        ("  95 % of the steps below", summary["p95_error_mm"], None),
        ("  maximum", summary["max_error_mm"], None),
    ]
    unreachable = summary["unreachable_steps"]
    if unreachable:
        share = f"{unreachable} of {summary['planned_steps']} points out of reach"
        rows.append((f"  unavoidable: {share}", summary["floor_mean_error_mm"], None))
    is_simulated = "true_mean_error_mm" in summary
    key = "true_mean_error_mm" if is_simulated else "mean_error_mm"
    laps = [
        (f"  lap {number}", lap[key], None)
        for number, lap in enumerate(summary["laps"] or (), start=1)
    ]
    if is_simulated:
        rows += [
            ("mean true error", summary[key], None),
            *laps,
            ("  floor", summary["twin_floor_mean_error_mm"], None),
            ("  ratio", ratio_to_twin_floor(summary), None),
        ]
    else:
        rows += laps
    has_paper = any(of_paper is not None for _, _, of_paper in rows)
    drive = f"{summary['path']} with {controller}{options.on_surface}"
    title = f"{drive}{_early_note(summary)}: tip error (mm)"
    table = Table(title=title, title_justify="left")
    table.add_column("")
    table.add_column("this run", justify="right")
    if has_paper:
        table.add_column("paper", justify="right")
    for name, value, of_paper in rows:
        papers = ("" if of_paper is None else _hundredths(of_paper),) if has_paper else ()
        table.add_row(name, _hundredths(value), *papers)
    twins = ("true", "floor", "ratio") if is_simulated else ()
    return _explained(table, "tip error", *(("paper",) if has_paper else ()), *twins)


def _explained(table: Table, *terms: str) -> Group:
    meanings = Table.grid(padding=(0, 2))
    for term in terms:
        meanings.add_row(term, _TERMS[term])
    return Group(table, meanings)


def remarks(runs: Sequence[RunResult]) -> Iterator[str]:
    """What is odd about the robot, and why its measured and true errors differ much, if they do."""
    yield from islice((run.remark for run in runs if run.remark), 1)
    causes = Counter(why_measured_differs(run.records) for run in runs)
    for cause, count in causes.items():
        if cause is not None:
            where = f" in {count} of {len(runs)} runs" if len(runs) > 1 else ""
            yield f"measured and true error differ{where}: {cause}"


def health_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Short lines about link, controller, board and tracker, with all errors."""
    link, solve = summary["link"], summary["solve_us"]
    rtt = link["rtt_us_median"]
    round_trip = f", round trip {rtt / 1000:.1f} ms" if rtt is not None else ""
    yield (
        f"link: {link['sent']} frames sent, {link['received']} received, "
        f"{link['crc_errors']} CRC errors, {link['retries']} retries{round_trip}"
    )
    if solve["median"] is not None:
        median, p99 = solve["median"], solve["p99"]
        yield f"controller: median {median:.0f} us per step, 99 % below {p99:.0f} us"
    if summary["missed_deadlines"]:
        skipped = summary["skipped_steps"]
        note = f", {skipped} of them skipped because they were too late" if skipped else ""
        yield f"missed deadlines: {summary['missed_deadlines']}{note}"
    if summary["board_holds"] or summary["board_relaxes"]:
        yield (
            f"without fresh targets the board held the pose: {summary['board_holds']} times; "
            f"started to move the robot to rest: {summary['board_relaxes']} times"
        )
    if summary["clamped_commands"]:
        yield (
            f"commands outside the angle limits, clamped by the board: "
            f"{summary['clamped_commands']}"
        )
    if summary["jumped_pictures"]:
        yield f"pictures left out, as a marker jumped there and back: {summary['jumped_pictures']}"
    if summary["tracker_lost_steps"]:
        yield (
            f"steps without a fresh tracker sample: {summary['tracker_lost_steps']}; commands from "
            f"the model alone: {summary['coasted_steps']}, pose held: {summary['held_steps']}"
        )


def comparison_table(
    summaries: Sequence[Mapping[str, Any]], options: Sequence[RunOptions]
) -> Group:
    """Controllers by path, next to the paper's results if the experiment is in the paper."""
    columns: dict[str, list[str]] = {
        "mean": [_hundredths(summary["mean_error_mm"]) for summary in summaries],
        "p95": [_hundredths(summary["p95_error_mm"]) for summary in summaries],
        "max": [_hundredths(summary["max_error_mm"]) for summary in summaries],
    }
    of_paper = [paper_mean_mm(run) for run in options]
    if any(mean_mm is not None for mean_mm in of_paper):
        columns["paper"] = ["" if mean_mm is None else _hundredths(mean_mm) for mean_mm in of_paper]
    if any("true_mean_error_mm" in summary for summary in summaries):
        columns |= {
            "true": [_hundredths(summary.get("true_mean_error_mm")) for summary in summaries],
            "floor": [_hundredths(summary["twin_floor_mean_error_mm"]) for summary in summaries],
            "ratio": [_hundredths(ratio_to_twin_floor(summary)) for summary in summaries],
        }
    table = _narrow_table(f"tip error (mm){options[0].on_surface}")
    for heading in ("path", "controller"):
        table.add_column(heading, no_wrap=True)
    for heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    previous = None
    for summary, *cells in zip(summaries, *columns.values(), strict=True):
        path = summary["path"]
        controller = f"{summary['controller']}{_early_note(summary)}"
        table.add_row(path if path != previous else "", controller, *cells)
        previous = path
    return _explained(table, "tip error", *(term for term in _TERMS if term in columns))


def _narrow_table(title: str, caption: str = "") -> Table:
    return Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE,
        collapse_padding=True,
        pad_edge=False,
        caption=caption or None,
        caption_justify="left",
    )


def sweep_table(groups: Sequence[Mapping[str, Any]]) -> Table:
    """Distributions over random twins, one row per controller and rate."""
    table = _narrow_table(
        "mean true error over the floor of the same twin",
        "excess: median above the floor (mm); limits: exceeded; early: ended by a fault",
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
            *(_hundredths(ratio[name]) for name in ("median", "p95", "max")),
            _hundredths(group["excess_mm"]["median"]),
            *(str(group[name]) for name in ("diverged", "outside_limits", "ended_early")),
        )
    return table


def worst_lines(groups: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The worst twins of each controller and rate."""
    for group in groups:
        worst = ", ".join(f"{run['index']} ({_reached(run)})" for run in group["worst"])
        yield f"worst twins of {group['controller']} at {group['rate_hz']:g} Hz: {worst}"


def _reached(run: Mapping[str, Any]) -> str:
    ratio = f"ratio {_hundredths(run['ratio'])}"
    return str(run["fault"]) or (f"{ratio}, diverged" if run["diverged"] else ratio)


def reach_table(reach: Mapping[str, Any]) -> Table:
    """Reachability of a path."""
    table = Table(title=f"reach of {reach['path']}", title_justify="left", show_header=False)
    table.add_row("points", str(reach["steps"]))
    table.add_row("out of reach", str(reach["unreachable_steps"]))
    table.add_row("mean unavoidable error (mm)", _hundredths(reach["floor_mean_error_mm"]))
    table.add_row("largest unavoidable error (mm)", _hundredths(reach["floor_max_error_mm"]))
    table.add_row("  at time (s)", f"{reach['floor_max_at_s']:g}")
    motors = zip(reach["motor_range_deg"], reach["motor_step_max_deg"], strict=True)
    for number, ((low, high), step) in enumerate(motors, start=1):
        table.add_row(f"motor {number} (deg)", f"{low:.1f} .. {high:.1f}")
        table.add_row("  largest step (deg)", f"{step:.1f}")
    return table


def _early_note(summary: Mapping[str, Any]) -> str:
    """Number of steps done, for a run that ended early."""
    steps, planned = summary["steps"], summary["planned_steps"]
    return f", only {steps} of {planned} steps" if steps < planned else ""


def _counted() -> tuple[ProgressColumn, ...]:
    return TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn()


def _progress(*columns: ProgressColumn) -> Progress:
    """A progress bar on standard error, shown on terminals only and removed at the end."""
    screen = console(on_stderr=True)
    return Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)


def _error_text(record: StepRecord) -> str:
    if record.measured_mm is None:
        return "markers lost"
    return f"error {np.linalg.norm(record.measured_mm - record.target_mm):5.1f} mm"


def _hundredths(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
