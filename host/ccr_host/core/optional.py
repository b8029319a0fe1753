"""Packages that only some trackers need."""

from __future__ import annotations

import importlib
from types import ModuleType

from ccr_host.core.errors import ConfigError


def import_optional(module: str, extra: str, what_for: str) -> ModuleType:
    """Import a package of an extra.

    Raises:
        ConfigError: it is not installed; the cure is the line that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigError(
            f"{what_for}: the package {module} is not installed",
            f'pip install "ccr-host[{extra}]"',
        ) from None
