"""Controllers by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from ccr_host.control.adaptive.control_law import AdaptiveStatics
from ccr_host.control.base import Controller
from ccr_host.control.mpc import ModelPredictive
from ccr_host.control.open_loop import OpenLoop
from ccr_host.core.errors import ConfigError, blaming
from ccr_host.description.schema import Description

_MAKERS: dict[str, Callable[[Description], Controller]] = {
    OpenLoop.name: OpenLoop,
    ModelPredictive.name: ModelPredictive,
    AdaptiveStatics.name: AdaptiveStatics,
}

_BASELINES = {
    "pid-ik": "pid_ik:PidIk",
    "broyden": "broyden:Broyden",
    "kalman-jacobian": "kalman_jacobian:KalmanJacobian",
    "mpc-offset": "mpc_offset:OffsetFreeMpc",
}
"""Module and class in ``control.baselines``; loaded only when one is asked for."""


def controller_names() -> list[str]:
    """The controllers of this project and of the paper."""
    return list(_MAKERS)


def baseline_names() -> list[str]:
    """Controllers as the field builds them, to compare with."""
    return list(_BASELINES)


def make_controller(name: str, description: Description) -> Controller:
    """Build a controller for a robot.

    Raises:
        ConfigError: unknown name; lists the known ones.
        CodeError: its class cannot be made.
    """
    if name not in _MAKERS and name not in _BASELINES:
        known = ", ".join([*_MAKERS, *_BASELINES])
        raise ConfigError(f"unknown controller {name}", f"one of {known}")
    make = _load_baseline(name) if name in _BASELINES else _MAKERS[name]
    with blaming(f"controller {name}", "correct its class"):
        made = make(description)
        if not (callable(made.start) and callable(made.step)):
            raise TypeError("start and step must be methods")
    return made


def _load_baseline(name: str) -> Callable[[Description], Controller]:
    module, _, maker = _BASELINES[name].partition(":")
    loaded = importlib.import_module(f"ccr_host.control.baselines.{module}")
    baseline: Callable[[Description], Controller] = getattr(loaded, maker)
    return baseline
