"""What other packages bring: extras that may be missing, and plug-ins by entry points."""

from __future__ import annotations

import importlib
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

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


def plugin(kind: str, name: str) -> Any:  # noqa: ANN401
    """What an installed package, this one included, offers as ``ccr_host.<kind>`` by this name.

    Raises:
        KeyError: there is no such plug-in.
    """
    return entry_points(group=f"ccr_host.{kind}")[name].load()
