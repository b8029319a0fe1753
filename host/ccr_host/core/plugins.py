"""Code from other packages: optional dependencies (extras), and plug-ins by entry point."""

from __future__ import annotations

import importlib
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from ccr_host.core.errors import ConfigError


def import_optional(module: str, extra: str, what_for: str) -> ModuleType:
    """Import a package that belongs to an extra.

    Raises:
        ConfigError: it is not installed; the cure is the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigError(
            f"{what_for}: the package {module} is not installed",
            f'pip install "ccr-host[{extra}]"',
        ) from None


def plugin(kind: str, name: str) -> Any:  # noqa: ANN401
    """Load the entry point ``name`` of the group ``ccr_host.<kind>`` from any installed package.

    Raises:
        KeyError: there is no such plug-in.
    """
    return entry_points(group=f"ccr_host.{kind}")[name].load()
