"""Keeps a registration in the user's robot description."""

from __future__ import annotations

import datetime
import os
from importlib import resources
from pathlib import Path
from typing import Any

from ccr_host.config import shipped_descriptions
from ccr_host.description_file import update_description
from ccr_host.errors import ConfigError
from ccr_host.tracking.registration import Registration

SECTION = "registration"


def registration_section(registration: Registration, date: datetime.date) -> dict[str, Any]:
    """The keys of ``[registration]``, rounded to what they are good for."""
    return {
        "camera_to_robot_deg": [round(float(v), 4) for v in registration.camera_to_robot_deg],
        "uncertainty_deg": [round(float(v), 2) for v in registration.uncertainty_deg],
        "residual_mm": round(registration.residual_mm, 3),
        "scale": round(registration.scale, 4),
        "date": date,
    }


def file_to_keep_it_in(robot: str | None, out: Path | None) -> Path | None:
    """Where a registration goes: to `out`, else into the user's own description, if there is one.

    To be asked before the robot moves.

    Args:
        robot: as given with ``--robot``.
        out: as given with ``--out``; made from the description of `robot` if it is not there.

    Raises:
        ConfigError: it could not be written.
    """
    own = None if robot is None or robot in shipped_descriptions() else Path(robot)
    file = out or own
    if file is not None:
        writable = file if file.exists() else file.resolve().parent
        if file.is_dir() or not os.access(writable, os.W_OK):
            raise ConfigError(
                f"robot description {file}: cannot be written", "name a TOML file that can be"
            )
    return file


def save_registration(file: Path, section: dict[str, Any], robot: str | None = None) -> None:
    """Put it into a robot description, in place of the present one.

    Args:
        file: copied from the description of `robot` if it is not there.
        section: of `registration_section`.
        robot: a file, the name of a shipped description, or None for the default one.

    Raises:
        ConfigError: the file cannot be read, edited or replaced; it is then as it was.
    """
    if not file.exists():
        file.write_text(_text_of(robot), encoding="utf-8")
    update_description(file, {SECTION: section})


def _text_of(robot: str | None) -> str:
    name = robot or "default"
    if name in shipped_descriptions():
        shipped = resources.files("ccr_host") / "descriptions" / f"{name}.toml"
        return shipped.read_text(encoding="utf-8")
    return Path(name).read_text(encoding="utf-8")
