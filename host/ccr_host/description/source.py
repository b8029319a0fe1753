"""Where the text of a robot description comes from: the user's file, or one in the package."""

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
    """The user's own description; None where `source` stands for a shipped one.

    Raises:
        ConfigError: `source` is empty.
    """
    if source == "":  # an unset variable of the shell; the path of nothing is the present folder
        raise ConfigError("robot description: its name is empty", "name a TOML file")
    return None if (source or _DEFAULT) in shipped_descriptions() else Path(source or _DEFAULT)


def text_of(source: str | None) -> str:
    """The TOML text of a description, with its own line ends.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.

    Raises:
        ConfigError: there is no such file, or it is not text.
    """
    return text_and_encoding_of(source)[0]


def text_and_encoding_of(source: str | None) -> tuple[str, str]:
    """The same, and the encoding of the file.

    Raises:
        ConfigError: see `text_of`.
    """
    file = own_file(source)
    if file is None:
        shipped = resources.files("ccr_host.description") / "shipped" / f"{source or _DEFAULT}.toml"
        return shipped.read_text(encoding="utf-8"), "utf-8"
    cure = f"give a TOML file or one of {', '.join(shipped_descriptions())}"
    return read_text(file, "robot description", cure, _MOST_BYTES)
