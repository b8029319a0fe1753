"""Measured data of real robots, which the project may use but does not contain."""

from __future__ import annotations

from pathlib import Path


def measured(name: str) -> Path | None:
    """A file of ``shared/data`` beside the project or one of its parents; None without it.

    Tests that need it are defined only if it is there: a skipped test counts as a defect.
    """
    folders = (parent / "shared" / "data" for parent in Path(__file__).resolve().parents)
    return next((folder / name for folder in folders if (folder / name).is_file()), None)
