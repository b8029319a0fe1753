"""Controllers by name."""

from __future__ import annotations

import importlib
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
    """
    if name in _PEERS:
        return _load_peer(name)(description)
    if name not in _MAKERS:
        known = ", ".join([*_MAKERS, *_PEERS])
        raise ConfigError(f"unknown controller {name}", f"one of {known}")
    return _MAKERS[name](description)


def _load_peer(name: str) -> Callable[[Description], Controller]:
    module, _, maker = _PEERS[name].partition(":")
    loaded = importlib.import_module(f"ccr_host.control.peers.{module}")
    peer: Callable[[Description], Controller] = getattr(loaded, maker)
    return peer
