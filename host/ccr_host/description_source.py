"""Where the text of a robot description comes from: the user's file, or one in the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from ccr_host.errors import ConfigError

_DEFAULT = "default"


def shipped_descriptions() -> list[str]:
    """Names of the descriptions that come with the package."""
    folder = resources.files("ccr_host") / "descriptions"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def own_file(source: str | None) -> Path | None:
    """The user's own description; None where `source` stands for a shipped one."""
    return None if (source or _DEFAULT) in shipped_descriptions() else Path(source or _DEFAULT)


def text_of(source: str | None) -> str:
    """The TOML text of a description.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.

    Raises:
        ConfigError: there is no such file, or it is not text.
    """
    name = source or _DEFAULT
    file = own_file(source) or resources.files("ccr_host") / "descriptions" / f"{name}.toml"
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"robot description {name}: {error.strerror}",
            f"give a TOML file or one of {', '.join(shipped_descriptions())}",
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"robot description {name}: {error}", "mend the TOML") from None
