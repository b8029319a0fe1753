"""Distributions of a sweep's runs, by controller and rate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccr_host.tools.sweep.job import Row

WORST = 3
"""So many of each group are named."""


def groups_of(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One object for each controller and rate.

    Ratios are of the true mean error to the floor of the same twin, errors of the true position. A
    run that diverged or ended early counts in the distributions with what it reached.
    """
    keys = sorted({(row["rate_hz"], row["controller"]) for row in rows})
    return [_group(key, [row for row in rows if _key(row) == key]) for key in keys]


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Runs that have no figures, then those that diverged, then by ratio."""
    return sorted(rows, key=lambda row: (_ratio(row), row["diverged"]), reverse=True)


def _key(row: Row) -> tuple[float, str]:
    return row["rate_hz"], row["controller"]


def _ratio(row: Row) -> float:
    return float("inf") if row["ratio"] is None else float(row["ratio"])


def _group(key: tuple[float, str], rows: Sequence[Row]) -> dict[str, Any]:
    known = [row for row in rows if row["ratio"] is not None]
    ratios = np.array([row["ratio"] for row in known])
    errors_mm = np.array([row["true_mean_error_mm"] for row in known])
    floors_mm = np.array([row["twin_floor_mean_error_mm"] for row in known])
    return {
        "controller": key[1],
        "rate_hz": key[0],
        "runs": len(rows),
        "diverged": sum(row["diverged"] for row in rows),
        "outside_limits": sum(not row["within_limits"] for row in rows),
        "ended_early": sum(bool(row["fault"]) for row in rows),
        "ratio": _quantiles(ratios),
        "excess_mm": _quantiles(errors_mm - floors_mm),
        "true_mean_error_mm": _quantiles(errors_mm),
        "cpu_s_median": _median([row["cpu_s"] for row in rows]),
        "worst": [
            {name: row[name] for name in ("index", "path", "ratio", "diverged", "fault", "command")}
            for row in worst_first(rows)[:WORST]
        ],
    }


def _quantiles(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float | None]:
    if not len(values):
        return {"median": None, "p95": None, "max": None}
    median, p95, greatest = np.percentile(values, (50, 95, 100))
    return {"median": float(median), "p95": float(p95), "max": float(greatest)}


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
