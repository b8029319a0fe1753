"""Controllers by name."""

from __future__ import annotations

from collections.abc import Callable

from ccr_host.control.adaptive.law import AdaptiveLaw
from ccr_host.control.base import Controller
from ccr_host.control.baselines import Broyden, KalmanJacobian, OffsetFreeMpc, PidIk
from ccr_host.control.mpc.controller import ModelPredictive
from ccr_host.control.open_loop import OpenLoop
from ccr_host.control.shell import Law, Shell
from ccr_host.core.plugins import is_plugin, make_plugin, unknown_plugin
from ccr_host.description.schema import Description

_MAKERS: dict[str, Callable[[Description], Controller]] = {
    OpenLoop.name: OpenLoop,
    ModelPredictive.name: ModelPredictive,
    AdaptiveLaw.name: lambda description: Shell(description, AdaptiveLaw(description)),
}

_BASELINES: dict[str, Callable[[Description], Law]] = {
    PidIk.name: PidIk,
    Broyden.name: Broyden,
    KalmanJacobian.name: KalmanJacobian,
    OffsetFreeMpc.name: OffsetFreeMpc,
}


DEFAULT_CONTROLLER = AdaptiveLaw.name
"""What follows a path best, of any robot."""


def controller_names() -> list[str]:
    """The controllers of this project and of the paper."""
    return list(_MAKERS)


def baseline_names() -> list[str]:
    """The baselines: controllers from the literature, for comparison."""
    return list(_BASELINES)


def rate_note(name: str, rate_hz: float, description: Description) -> str:
    """What happens to a controller at a rate that it was not made for; empty if it was."""
    is_printed = name == ModelPredictive.name and description.control.bending == "commanded"
    shortest_s = ModelPredictive.shortest_printed_s
    if not is_printed or rate_hz * shortest_s <= 1.0:
        return ""
    return (
        f"{name} as printed (control.bending = commanded) leaves out the delays of camera and "
        f"servos: above {1.0 / shortest_s:g} Hz it may swing, or leave the path by tens of mm; "
        f"take --set control.bending=estimated, or {DEFAULT_CONTROLLER}"
    )


def make_controller(name: str, description: Description) -> Controller:
    """Build a controller for a robot.

    ``name`` is a built-in controller or one of `is_plugin`.

    Raises:
        ConfigError: unknown name; lists the known ones.
        CodeError: the plug-in cannot be constructed.
    """
    if name in _BASELINES:
        return Shell(description, _BASELINES[name](description))
    if name in _MAKERS:
        return _MAKERS[name](description)
    if not is_plugin("controller", name):
        raise unknown_plugin("controller", name, [*_MAKERS, *_BASELINES])
    made: Controller = make_plugin("controller", name, ("start", "step"), description)
    return made
