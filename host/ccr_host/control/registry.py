"""Controllers by name."""

from __future__ import annotations

from collections.abc import Callable

from ccr_host.config import Description
from ccr_host.control.adaptive.controller import AdaptiveStatics
from ccr_host.control.base import Controller
from ccr_host.control.mpc import ModelPredictive
from ccr_host.control.open_loop import OpenLoop
from ccr_host.errors import ConfigError

_MAKERS: dict[str, Callable[[Description], Controller]] = {
    OpenLoop.name: OpenLoop,
    ModelPredictive.name: ModelPredictive,
    AdaptiveStatics.name: AdaptiveStatics,
}


def controller_names() -> list[str]:
    """The controllers that ``make_controller`` knows."""
    return list(_MAKERS)


def make_controller(name: str, description: Description) -> Controller:
    """Build a controller for a robot.

    Raises:
        ConfigError: unknown name; lists the known ones.
    """
    if name not in _MAKERS:
        raise ConfigError(f"unknown controller {name}", f"one of {', '.join(_MAKERS)}")
    return _MAKERS[name](description)
