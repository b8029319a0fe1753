"""What a package adds to this one: controllers, trackers and simulated robots by entry points."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any


def plugin(kind: str, name: str) -> Any:  # noqa: ANN401
    """What an installed package, this one included, offers as ``ccr_host.<kind>`` by this name.

    Raises:
        KeyError: there is no such plug-in.
    """
    return entry_points(group=f"ccr_host.{kind}")[name].load()
