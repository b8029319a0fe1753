"""Writes what was measured into the user's robot description and leaves all else as it is."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ccr_host import config
from ccr_host.errors import ConfigError

Sections = Mapping[str, Mapping[str, Any]]
"""New values by section and key."""


def updated(text: str, sections: Sections) -> str:
    """The text of a description with new values; comments, order and other keys stay.

    Raises:
        ConfigError: the text is no TOML, or a section is no table.
    """
    try:
        document = tomlkit.parse(text)
        for name, values in sections.items():
            table = document.setdefault(name, tomlkit.table())
            for key, value in values.items():
                table[key] = value
        return tomlkit.dumps(document)
    except (TOMLKitError, TypeError) as error:
        raise ConfigError(f"robot description: {error}", "mend the TOML") from None


def update_description(file: Path, sections: Sections) -> None:
    """Rewrite a robot description at once or not at all.

    Raises:
        ConfigError: it cannot be read, would not be a description, or cannot be replaced; it is
            then as it was.
    """
    target = file.resolve()
    try:
        text = updated(target.read_text(encoding="utf-8"), sections)
        config.parse(text)
        _replace(target, text)
    except OSError as error:
        raise ConfigError(
            f"robot description {file}: {error.strerror}", "name a TOML file that can be written"
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"robot description {file}: {error}", "mend the TOML") from None


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
