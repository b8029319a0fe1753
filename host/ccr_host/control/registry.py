"""Controllers by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from ccr_host.config import Description
from ccr_host.control.adaptive.controller import AdaptiveStatics
from ccr_host.control.base import Controller
from ccr_host.control.mpc import ModelPredictive
from ccr_host.control.open_loop import OpenLoop
from ccr_host.errors import ConfigError, blaming

_MAKERS: dict[str, Callable[[Description], Controller]] = {
    OpenLoop.name: OpenLoop,
    ModelPredictive.name: ModelPredictive,
    AdaptiveStatics.name: AdaptiveStatics,
}

_PEERS = {
    "pid-ik": "pid_ik:PidIk",
    "broyden": "broyden:Broyden",
    "kalman-jacobian": "kalman_jacobian:KalmanJacobian",
    "mpc-offset": "mpc_offset:OffsetFreeMpc",
}
"""Module and class in ``control.peers``; loaded only when one is asked for."""


def controller_names() -> list[str]:
    """The controllers of this project and of the paper."""
    return list(_MAKERS)


def peer_names() -> list[str]:
    """Controllers as the field builds them, to compare with."""
    return list(_PEERS)


def make_controller(name: str, description: Description) -> Controller:
    """Build a controller for a robot.

    Raises:
        ConfigError: unknown name; lists the known ones.
        CodeError: its class cannot be made.
    """
    if name not in _MAKERS and name not in _PEERS:
        known = ", ".join([*_MAKERS, *_PEERS])
        raise ConfigError(f"unknown controller {name}", f"one of {known}")
    make = _load_peer(name) if name in _PEERS else _MAKERS[name]
    with blaming(f"controller {name}", "correct its class"):
        made = make(description)
        if not (callable(made.start) and callable(made.step)):
            raise TypeError("start and step must be methods")
    return made


def _load_peer(name: str) -> Callable[[Description], Controller]:
    module, _, maker = _PEERS[name].partition(":")
    loaded = importlib.import_module(f"ccr_host.control.peers.{module}")
    peer: Callable[[Description], Controller] = getattr(loaded, maker)
    return peer
