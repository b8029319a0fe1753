"""Where the binaries of a simulated UNO are found and kept."""

from __future__ import annotations

import os
from pathlib import Path

from ccr_host.errors import ConfigError

_BUILT = Path(".pio/build/uno/firmware.elf")
_CHECKOUT = Path(__file__).parents[3]
RELEASED_FIRMWARE = Path(__file__).parents[1] / "firmware" / "uno.hex"
"""What scripts/release puts into the package; a checkout has none."""


def find_firmware(given: str = "") -> Path:
    """The firmware's ELF or HEX file: the given one, what `pio run` has built, or the released one.

    Raises:
        ConfigError: there is none.
    """
    if given:
        return Path(given)
    for file in (Path.cwd() / _BUILT, _CHECKOUT / _BUILT, RELEASED_FIRMWARE):
        if file.exists():
            return file
    raise ConfigError(
        f"simavr: no firmware binary {_BUILT}", "build it with pio run, or write simavr:FILE.elf"
    )


def cache_folder() -> Path:
    """Of what is built on this machine on demand."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ccr-host"
