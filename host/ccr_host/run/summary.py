"""The JSON summary of a run; scripts of users rely on its keys (see docs/command-line.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ccr_host.control.base import Outcome
from ccr_host.core.arrays import Array
from ccr_host.core.errors import full_text
from ccr_host.link.exchange import LinkStatistics
from ccr_host.robot.reference import PATH_AXES, REACHABLE_MM, Reference
from ccr_host.run.observer import StepRecord, measured_errors_mm, true_errors_mm
from ccr_host.run.options import RunOptions

LATERAL = [PATH_AXES["y"], PATH_AXES["z"]]

_ERROR_KEYS = (
    "mean_error_mm", "rmse_mm", "p95_error_mm", "max_error_mm", "mean_lateral_error_mm",
)  # fmt: skip
_LINK_KEYS = ("sent", "received", "crc_errors", "retries", "rtt_us_median", "rtt_us_p99")


def statistics_of(errors_mm: Array, prefix: str = "") -> dict[str, float | None]:
    """Statistics of the norms of error vectors, (N, 3), by their keys in the JSON summary.

    Rows with NaN do not count; all are None if no row is left.
    """
    known = errors_mm[np.isfinite(errors_mm).all(axis=1)]
    figures: list[float | None] = [None] * len(_ERROR_KEYS)
    if len(known):
        norms = np.linalg.norm(known, axis=1)
        figures = [
            float(norms.mean()),
            float(np.sqrt((norms**2).mean())),
            float(np.percentile(norms, 95)),
            float(norms.max()),
            float(np.linalg.norm(known[:, LATERAL], axis=1).mean()),
        ]
    return {f"{prefix}{key}": value for key, value in zip(_ERROR_KEYS, figures, strict=True)}


def quantiles_us(durations_us: Array) -> dict[str, float | None]:
    """Median, 99th percentile and maximum; all None if nothing was timed."""
    if not len(durations_us):
        return {"median": None, "p99": None, "max": None}
    return {
        "median": float(np.median(durations_us)),
        "p99": float(np.percentile(durations_us, 99)),
        "max": float(durations_us.max()),
    }


TIMING_KEYS = ("solve_us", "wall_s")
"""Keys that depend on the machine; all others repeat with the seed in virtual time."""


@dataclass(frozen=True)
class RunResult:
    """A run that has ended, successfully or not."""

    options: RunOptions
    reference: Reference
    records: Sequence[StepRecord]
    link: LinkStatistics | None
    """None if the board was never reached."""
    failure: Exception | KeyboardInterrupt | None
    """The error that ended the run early; None if it was completed."""
    wall_s: float
    jumped_pictures: int = 0
    """Pictures left out since a marker had jumped for that picture alone."""
    started: bool = True
    """Whether the robot was armed."""
    remark: str = ""
    """What the moves before the path say about the robot, if that is odd."""
    log_trouble: str = ""
    """What is missing from the log, and why; empty if nothing is."""


def summarise(
    result: RunResult,
    open_loop: RunResult | None = None,
    twin_floor_mm: float | None = None,
) -> dict[str, Any]:
    """Summarise a run, with the error figures of the open loop if that was run too."""
    reference, records = result.reference, result.records
    solved_us = [record.solve_us for record in records if record.solve_us > 0]
    outcomes, link = Counter(record.outcome for record in records), result.link
    return {
        "path": reference.name,
        "controller": result.options.controller,
        "surface": result.options.surface,
        "rate_hz": result.options.rate_hz,
        "steps": len(records),
        "planned_steps": len(reference),
        "seed": result.options.seed,
        "device": result.options.device,
        "tracker": result.options.tracker,
        **error_figures(records),
        "floor_mean_error_mm": reference.floor_mean_mm,
        "twin_floor_mean_error_mm": twin_floor_mm,
        "unreachable_steps": reference.unreachable_steps,
        "laps": _lap_figures(records, reference) if reference.laps > 1 else None,
        "open": None if open_loop is None else error_figures(open_loop.records),
        "solve_us": quantiles_us(np.array(solved_us)),
        "missed_deadlines": sum(record.late for record in records),
        "tracker_lost_steps": sum(record.measured_mm is None for record in records),
        "jumped_pictures": result.jumped_pictures,
        "coasted_steps": outcomes[Outcome.COASTED],
        "held_steps": outcomes[Outcome.HELD],
        "skipped_steps": outcomes[Outcome.SKIPPED],
        "clamped_commands": None if link is None else link.clamped_targets,
        "board_holds": None if link is None else link.holds,
        "board_relaxes": None if link is None else link.relaxes,
        "link": None if link is None else {key: getattr(link, key) for key in _LINK_KEYS},
        "wall_s": result.wall_s,
        "faults": [full_text(result.failure)] if isinstance(result.failure, Exception) else [],
    }


def _lap_figures(
    records: Sequence[StepRecord], reference: Reference
) -> list[dict[str, float | None]]:
    """The error figures of each lap that was begun."""
    starts = range(0, len(records), reference.lap_steps)
    return [error_figures(records[start : start + reference.lap_steps]) for start in starts]


def ratio_to_twin_floor(summary: Mapping[str, Any]) -> float | None:
    """Mean true error divided by the least that the twin allows.

    None without a twin, or if it can reach the whole path.
    """
    error_mm, floor_mm = summary.get("true_mean_error_mm"), summary.get("twin_floor_mean_error_mm")
    if error_mm is None or floor_mm is None or floor_mm <= REACHABLE_MM:
        return None
    return float(error_mm / floor_mm)


def error_figures(records: Sequence[StepRecord]) -> dict[str, float | None]:
    """Statistics of the measured errors and, with a twin, of the true ones."""
    truth = true_errors_mm(records)
    true_figures = {} if truth is None else statistics_of(truth, "true_")
    return statistics_of(measured_errors_mm(records)) | true_figures
