"""Source of a robot description's text: the user's file, or one shipped with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

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


def text_of(source: str | None) -> str:
    """TOML text of a description, with its original line endings.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.

    Raises:
        ConfigError: the file does not exist or is not text.
    """
    return text_and_encoding_of(source)[0]


def text_and_encoding_of(source: str | None) -> tuple[str, str]:
    """Text of a description, and the encoding of its file; see `text_of`."""
    file = own_file(source)
    if file is None:
        shipped = resources.files("ccr_host.description") / "shipped" / f"{source or _DEFAULT}.toml"
        return shipped.read_text(encoding="utf-8"), "utf-8"
    cure = f"give a TOML file or one of {', '.join(shipped_descriptions())}"
    return read_text(file, "robot description", cure, _MOST_BYTES)
