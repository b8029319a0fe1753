"""Turns recorded runs into one page that needs no other file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, Undefined

from ccr_host.errors import ConfigError
from ccr_host.run.measured_and_true import why_measured_differs
from ccr_host.run.report.figures import health_svg, overlay_svgs, path_svg
from ccr_host.run.report.recorded_run import RecordedRun, read_run
from ccr_host.user_file import replacing

_DASH = "-"


def write_report(folders: Sequence[Path], file: Path) -> list[RecordedRun]:
    """Write the page.

    Args:
        folders: of the runs, in the order in which they shall appear.
        file: HTML to write.

    Returns:
        The runs.

    Raises:
        ConfigError: a folder holds no run, or the file cannot be written.
    """
    runs = [read_run(folder) for folder in folders]
    page = report_page(runs)
    try:
        with replacing(file) as draft:
            draft.write_text(page, encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise ConfigError(
            f"report {file}: {error.strerror}", "name a file that can be written"
        ) from None
    return runs


def report_page(runs: Sequence[RecordedRun]) -> str:
    """HTML with everything in it."""
    environment = Environment(loader=PackageLoader("ccr_host.run.report", "."), autoescape=True)
    environment.filters |= {
        "mm": _mm,
        "ratio": _ratio,
        "dash": _dash,
        "configuration": _configuration,
        "why_measured_differs": why_measured_differs,
    }
    figures = [(path_svg(run), health_svg(run)) if run.records else ("", "") for run in runs]
    titles = [run.title for run in runs]
    names = [
        title if titles.count(title) == 1 else f"{title}, {run.folder.name}"
        for run, title in zip(runs, titles, strict=True)
    ]
    return environment.get_template("page.html.j2").render(
        title=titles[0] if len({*titles}) == 1 else f"{len(runs)} runs",
        runs=runs,
        names=names,
        figures=figures,
        overlays=list(overlay_svgs(runs, names)),
    )


def _mm(value: float | Undefined | None) -> str:
    return f"{value:.2f}" if isinstance(value, float) else _DASH


def _dash(value: int | Undefined | None) -> str:
    return str(value) if isinstance(value, int) else _DASH


def _ratio(metrics: Mapping[str, Any]) -> str:
    truth, floor = metrics.get("true_mean_error_mm"), metrics.get("twin_floor_mean_error_mm")
    return f"{truth / floor:.2f}" if truth and floor else _DASH


def _configuration(run: RecordedRun) -> str:
    options = {**vars(run.setup.options), "overrides": list(run.setup.options.overrides)}
    content = {
        "versions": run.versions,
        "options": options,
        "description": run.setup.description.model_dump(),
    }
    return json.dumps(content, indent=2)
