"""Source of a robot description's text: the user's file, or one shipped with the package."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import read_text

_DEFAULT = "default"
_MOST_BYTES = 1_000_000


def shipped_descriptions() -> list[str]:
    """Names of the descriptions that come with the package."""
    folder = resources.files("ccr_host.description") / "shipped"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def own_file(source: str | None) -> Path | None:
    """Path of the user's own description; None if `source` names a shipped one.

    Raises:
        ConfigError: `source` is empty.
    """
    if source == "":  # an unset shell variable; Path("") would be the current folder
        raise ConfigError("robot description: its name is empty", "name a TOML file")
    return None if (source or _DEFAULT) in shipped_descriptions() else Path(source or _DEFAULT)


def text_and_encoding_of(source: str | None) -> tuple[str, str]:
    """TOML text of a description, with its original line endings, and the encoding of its file.

    ``source`` is a TOML file or the name of a shipped description; None for the default.

    Raises:
        ConfigError: the file does not exist or is not text.
    """
    file = own_file(source)
    if file is None:
        shipped = resources.files("ccr_host.description") / "shipped" / f"{source or _DEFAULT}.toml"
        return shipped.read_text(encoding="utf-8"), "utf-8"
    cure = f"give a TOML file or one of {', '.join(shipped_descriptions())}"
    return read_text(file, "robot description", cure, _MOST_BYTES)


def tree_of(text: str, source: str | None = None) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ConfigError: the text is not valid TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        name = f" {source}" if source else ""
        raise ConfigError(f"robot description{name}: {error}", "correct the TOML") from None


def tree_with(tree: dict[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """The same tables with overrides, ``section.key=value``, applied.

    Raises:
        ConfigError: an override is malformed, or its key does not exist.
    """
    for override in overrides:
        _apply(tree, override)
    return tree


def _apply(tree: dict[str, Any], override: str) -> None:
    path, equals, text = override.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise ConfigError(f"--set {override}: not KEY=VALUE", "write e.g. --set twin.slack_mm=0.8")
    *sections, last = keys
    node = tree
    for key in sections:
        node = node.setdefault(key, {})
        if not isinstance(node, dict):
            raise ConfigError(
                f"--set {override}: {key} has no keys below it", "see docs/robot-description.md"
            )
    node[last] = _parse_value(text.strip())


def _parse_value(text: str) -> Any:  # noqa: ANN401 - any TOML value
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
