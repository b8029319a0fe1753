"""The folder that a run leaves behind."""

from __future__ import annotations

import json
import re
from datetime import datetime
from pathlib import Path
from typing import Any

from ccr_host.errors import ConfigError

METRICS_FILE = "run.json"
"""Configuration and summary of a run."""
_LONGEST_SLUG = 80


def make_run_folder(wanted: Path | None, title: str) -> Path:
    """Create the folder: the one asked for, or ``runs/<date>-<title>``.

    Raises:
        ConfigError: it cannot be created or written to.
    """
    folder = wanted or _unused(Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{_slug(title)}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ConfigError(
            f"--out {folder}: {error.strerror}", "name a folder that can be written"
        ) from None
    return folder


def write_json(file: Path, content: dict[str, Any]) -> None:
    """Indented, with a final newline."""
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _slug(title: str) -> str:
    """Short, and without what a shell or another system could take amiss in a name."""
    return re.sub(r"[^A-Za-z0-9._+-]+", "-", title)[:_LONGEST_SLUG].strip("-.")


def _unused(folder: Path) -> Path:
    candidates = (folder.with_name(f"{folder.name}-{n}") for n in range(2, 1000))
    return folder if not folder.exists() else next(c for c in candidates if not c.exists())
