"""Distributions of a sweep's runs, by controller and rate, in numbers and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ccr_host.record.figure_style import controller_colours, plain, save_figure
from ccr_host.tools.sweep.job import Row

WORST = 3
"""Number of worst runs listed for each group."""


def groups_of(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Statistics as one object for each controller and rate.

    Ratios are true mean error over the floor of the same twin; errors are those of the true
    position. Runs that diverged or ended early are included with the errors that they reached.
    """
    keys = sorted({(row["rate_hz"], row["controller"]) for row in rows})
    return [_group(key, [row for row in rows if _key(row) == key]) for key in keys]


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Runs sorted with those without results first, then by ratio, or excess, largest first."""
    return sorted(rows, key=lambda row: (*_badness(row), row["diverged"]), reverse=True)


def _key(row: Row) -> tuple[float, str]:
    return row["rate_hz"], row["controller"]


def _badness(row: Row) -> tuple[float, float]:
    """The ratio; the excess where a twin can reach all of the path."""
    if row["ratio"] is not None:
        return float(row["ratio"]), 0.0
    excess_mm = _excess_mm(row)
    return (float("inf"), 0.0) if excess_mm is None else (0.0, excess_mm)


def _excess_mm(row: Row) -> float | None:
    error_mm, floor_mm = row.get("true_mean_error_mm"), row.get("twin_floor_mean_error_mm")
    return None if error_mm is None or floor_mm is None else float(error_mm - floor_mm)


def _group(key: tuple[float, str], rows: Sequence[Row]) -> dict[str, Any]:
    known = [row for row in rows if _excess_mm(row) is not None]
    ratios = np.array([row["ratio"] for row in known if row["ratio"] is not None])
    return {
        "controller": key[1],
        "rate_hz": key[0],
        "runs": len(rows),
        "diverged": sum(row["diverged"] for row in rows),
        "outside_limits": sum(not row["within_limits"] for row in rows),
        "ended_early": sum(bool(row["fault"]) for row in rows),
        "ratio": _quantiles(ratios),
        "excess_mm": _quantiles(np.array([_excess_mm(row) for row in known], dtype=np.float64)),
        "true_mean_error_mm": _quantiles(np.array([row["true_mean_error_mm"] for row in known])),
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


if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARKERS = {True: "X", False: "o"}


def write_sweep_figure(file: Path, rows: Sequence[Row]) -> None:
    """Draw a row of panels per rate: distribution of the ratio, and error over floor.

    ``file`` is the PNG; PDF and SVG are written next to it. Rows without results are left out.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - costs 0.7 s

    known = [row for row in rows if row["ratio"] is not None]
    rates = sorted({row["rate_hz"] for row in known}) or [1.0]
    names = sorted({row["controller"] for row in known})
    palette = controller_colours(names)
    colours = {name: palette[name] for name in names}
    figure = Figure(figsize=(11, 1.0 + 4.2 * len(rates)), layout="constrained")
    panels = figure.subplots(len(rates), 2, squeeze=False)
    for (distribution, scatter), rate_hz in zip(panels, rates, strict=True):
        of_rate = [row for row in known if row["rate_hz"] == rate_hz]
        groups = {name: [r for r in of_rate if r["controller"] == name] for name in colours}
        _draw_distribution(distribution, groups, colours)
        _draw_scatter(scatter, groups, colours)
        distribution.set_title(f"{rate_hz:g} Hz", loc="left")
    save_figure(figure, file)


def _draw_distribution(axes: Axes, groups: dict[str, list[Row]], colours: dict[str, str]) -> None:
    for name, rows in groups.items():
        ratios = np.sort([row["ratio"] for row in rows])
        if len(ratios):
            share = np.arange(1, len(ratios) + 1) / len(ratios)
            axes.step(ratios, share, where="post", color=colours[name], label=plain(name))
    axes.set_xscale("log")
    axes.set_xlim(left=1.0)
    _write_out_numbers(axes)
    axes.set_ylim(0.0, 1.0)
    axes.axhline(0.95, color="#999999", linewidth=0.8, linestyle=":")
    axes.axhline(0.5, color="#999999", linewidth=0.8, linestyle=":")
    axes.set_xlabel("mean true error over the twin's own floor")
    axes.set_ylabel("share of the runs")
    axes.grid(alpha=0.3, which="both")
    if any(groups.values()):
        axes.legend(loc="lower right", frameon=False)


def _write_out_numbers(axes: Axes) -> None:
    """Label logarithmic axes with plain numbers instead of powers of ten."""
    from matplotlib.ticker import LogFormatter  # noqa: PLC0415 - as above

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.5)))


def _draw_scatter(axes: Axes, groups: dict[str, list[Row]], colours: dict[str, str]) -> None:
    for name, rows in groups.items():
        for diverged, marker in _MARKERS.items():
            chosen = [row for row in rows if row["diverged"] == diverged]
            axes.scatter(
                [row["twin_floor_mean_error_mm"] for row in chosen],
                [row["true_mean_error_mm"] for row in chosen],
                s=14,
                marker=marker,
                color=colours[name],
                alpha=0.6,
                linewidths=0,
            )
        for row in worst_first(rows)[:WORST]:
            axes.annotate(
                str(row["index"]),
                (row["twin_floor_mean_error_mm"], row["true_mean_error_mm"]),
                xytext=(4, 3),
                textcoords="offset points",
                fontsize=8,
                color=colours[name],
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    axes.plot((low, high), (low, high), color="#999999", linewidth=0.8)
    axes.set_xlim(low, high)
    axes.set_xlabel("floor of the twin (mm)")
    axes.set_ylabel("mean true error (mm)")
    axes.set_title("numbers: worst twins; crosses: diverged", loc="left", fontsize=9)
    _write_out_numbers(axes)
    axes.grid(alpha=0.3, which="both")
