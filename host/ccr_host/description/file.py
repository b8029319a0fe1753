"""Writes measured values into the user's robot description and leaves the rest of it unchanged."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ccr_host.core.errors import ConfigError, why
from ccr_host.core.user_file import keep_elsewhere, replacing
from ccr_host.description import schema
from ccr_host.description.source import own_file, text_and_encoding_of

_BARE_LINE_END = re.compile(r"(?<!\r)\n")

Sections = Mapping[str, Mapping[str, Any]]
"""New values by section and key."""


def file_to_keep_in(robot: str | None, out: Path | None) -> Path | None:
    """File for a measurement: `out`, else the user's own description; None if there is neither.

    Call it before the robot moves. ``robot`` and ``out``, which need not exist yet, are as given
    with the options of these names.

    Raises:
        ConfigError: the file is not writable.
    """
    file = out or own_file(robot)
    if file is not None and not _can_be_replaced(file):
        raise ConfigError(
            f"robot description {file}: cannot be written", "name a TOML file that can be"
        )
    return file


def _can_be_replaced(file: Path) -> bool:
    """Whether the file can be written or created, and its folder can hold a draft of it."""
    try:
        is_free = not file.exists() or (file.is_file() and os.access(file, os.W_OK))
        folder = Path(os.path.realpath(file)).parent
        return is_free and folder.is_dir() and os.access(folder, os.W_OK)
    except (OSError, ValueError):
        return False


def begin_description(file: Path, robot: str | None) -> bool:
    """Create a robot description if the file does not exist; return whether it was created.

    If ``robot``, as given with ``--robot``, is the file itself, it gets only a name.

    Raises:
        ConfigError: it cannot be created.
    """
    if file.exists():
        return False
    if own_file(robot) == file:
        _write(file, f"name = {json.dumps(file.stem)}\n".encode())
    else:
        keep_in(file, {}, robot)
    return True


def keep_in(file: Path, sections: Sections, robot: str | None) -> None:
    """Rewrite a robot description atomically.

    ``file`` is as returned by `file_to_keep_in`; if it does not exist, it is created from
    ``robot``.

    Raises:
        ConfigError: the file cannot be read, would become invalid, or cannot be replaced; it is
            left unchanged, and the values are kept in another file, which is named.
    """
    target = file.resolve()
    try:
        text, encoding = text_and_encoding_of(str(target) if target.exists() else robot)
        text = updated(text, sections)
        schema.parse(text)
        _write(target, text.encode(encoding))
    except ConfigError as error:
        if not sections:
            raise
        try:
            elsewhere = keep_elsewhere(updated("", sections), ".toml")
        except OSError:
            raise error from None
        named = str(file) in error.cause or str(target) in error.cause
        raise ConfigError(
            error.cause if named else f"{file}: {error.cause}",
            f"what was measured is in {elsewhere}: copy it into a description",
        ) from None


def _write(file: Path, content: bytes) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)  # it may have been deleted meanwhile
        with replacing(file) as draft:
            draft.write_bytes(content)
    except OSError as error:
        raise ConfigError(
            f"robot description {file}: {why(error)}", "name a TOML file that can be written"
        ) from None


def _set_in(table: MutableMapping[str, Any], values: Mapping[str, Any]) -> None:
    """Set keys of a table; tables in a list of the same length are changed and not replaced."""
    for key, value in values.items():
        if key not in table or not _are_tables(table[key], value):
            table[key] = value
            continue
        for there, new in zip(table[key], value, strict=True):
            _set_in(there, new)


def _are_tables(there: object, value: object) -> bool:
    """Whether both are lists of tables, of the same length."""
    if not (isinstance(there, list) and isinstance(value, list) and len(there) == len(value)):
        return False
    return all(isinstance(member, Mapping) for member in (*there, *value))


def updated(text: str, sections: Sections) -> str:
    """Text of a description with new values; comments, order, line endings and other keys stay.

    Raises:
        ConfigError: the text is not valid TOML, or a section is not a table.
    """
    try:
        document = tomlkit.parse(text)
        for name, values in sections.items():
            table = document.setdefault(name, tomlkit.table())
            _set_in(table, values)
        new = tomlkit.dumps(document)
    except (TOMLKitError, TypeError, ValueError, RecursionError) as error:
        raise ConfigError(f"robot description: {error}", "correct the TOML") from None
    has_windows_ends = "\r\n" in text and not _BARE_LINE_END.search(text)
    return _BARE_LINE_END.sub("\r\n", new) if has_windows_ends else new
