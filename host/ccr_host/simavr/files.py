"""Where the binaries of a simulated UNO are found and kept."""

from __future__ import annotations

import os
from pathlib import Path

from ccr_host.errors import ConfigError

_BUILT = Path(".pio/build/uno/firmware.elf")
_CHECKOUT = Path(__file__).parents[3]


def find_firmware(given: str = "") -> Path:
    """The firmware's ELF or HEX file: the given one, or what `pio run` has built.

    Raises:
        ConfigError: there is none.
    """
    if given:
        return Path(given)
    for folder in (Path.cwd(), _CHECKOUT):
        if (folder / _BUILT).exists():
            return folder / _BUILT
    raise ConfigError(
        f"simavr: no firmware binary {_BUILT}", "build it with pio run, or write simavr:FILE.elf"
    )


def cache_folder() -> Path:
    """Of what is built on this machine on demand."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ccr-host"
