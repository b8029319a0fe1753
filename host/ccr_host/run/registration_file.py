"""Keeps a registration in the user's robot description without touching anything else in it."""

from __future__ import annotations

import contextlib
import datetime
import os
import re
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from ccr_host.errors import ConfigError
from ccr_host.tracking.registration import Registration

SECTION = "registration"

_HEADER = re.compile(r"^\s*\[+\s*([^\]\s]+)\s*\]+", re.MULTILINE)


def registration_section(registration: Registration, date: datetime.date) -> dict[str, Any]:
    """The keys of ``[registration]``, rounded to what they are good for."""
    return {
        "camera_to_robot_deg": [round(float(v), 4) for v in registration.camera_to_robot_deg],
        "uncertainty_deg": [round(float(v), 2) for v in registration.uncertainty_deg],
        "residual_mm": round(registration.residual_mm, 3),
        "scale": round(registration.scale, 4),
        "date": date,
    }


def with_registration(text: str, section: dict[str, Any]) -> str:
    """Put the section in place of the present one, or at the end; other lines stay as they are.

    Raises:
        ConfigError: the text keeps its registration in a form that cannot be edited safely.
    """
    block = [f"[{SECTION}]  # written by ccr-host register"]
    block += [f"{key} = {_toml(value)}" for key, value in section.items()]
    start, end = _span(text)
    before, after = text[:start].rstrip(), text[end:].lstrip("\n")
    parts = [before, "\n".join(block), after.rstrip()]
    edited = "\n\n".join(part for part in parts if part) + "\n"
    if not _differs_only_in_registration(text, edited, section):
        raise ConfigError(
            f"the [{SECTION}] section of the robot description cannot be replaced",
            f"write it as a plain table: {'; '.join(block[1:])}",
        )
    return edited


def save_registration(file: Path, section: dict[str, Any]) -> None:
    """Rewrite a robot description at once or not at all.

    Raises:
        ConfigError: it cannot be read, edited or replaced; it is then as it was.
    """
    target = file.resolve()
    try:
        text = target.read_text(encoding="utf-8")
        edited = with_registration(text, section)
        _replace(target, edited)
    except OSError as error:
        raise ConfigError(
            f"robot description {file}: {error.strerror}", "name a TOML file that can be written"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"robot description {file}: {error}", "mend the TOML") from None


def _span(text: str) -> tuple[int, int]:
    """From the header of the section to where the next one, or the comment above it, begins."""
    headers = list(_HEADER.finditer(text))
    for index, header in enumerate(headers):
        if header.group(1) == SECTION:
            end = headers[index + 1].start() if index + 1 < len(headers) else len(text)
            return header.start(), _before_comments(text, header.end(), end)
    return len(text), len(text)


def _before_comments(text: str, start: int, end: int) -> int:
    """Leave to the next section the comments right above it."""
    lines = text[start:end].splitlines(keepends=True)
    while len(lines) > 1 and (not lines[-1].strip() or lines[-1].lstrip().startswith("#")):
        end -= len(lines.pop())
    return end


def _differs_only_in_registration(text: str, edited: str, section: dict[str, Any]) -> bool:
    expected = tomllib.loads(text)
    expected[SECTION] = section
    try:
        return tomllib.loads(edited) == expected
    except tomllib.TOMLDecodeError:
        return False


def _toml(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    return value.isoformat() if isinstance(value, datetime.date) else repr(value)


def _replace(target: Path, text: str) -> None:
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    draft = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        draft.chmod(target.stat().st_mode)
        draft.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
