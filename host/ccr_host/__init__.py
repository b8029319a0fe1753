"""Control stack for tendon-driven continuum robots.

    with ccr_host.open_robot() as robot:
        robot.arm()
        robot.move([10, -20])
        run = robot.track("8shape")
    run.steps

The names listed here are the interface for programs. They are imported when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ccr_host.core.errors import CcrError, CodeError, ConfigError, DeviceError, TrackerError

if TYPE_CHECKING:
    from ccr_host.control.base import Command, Controller, Observation, Outcome
    from ccr_host.core import __version__
    from ccr_host.description.schema import Description
    from ccr_host.run.observer import RunObserver
    from ccr_host.sim.robot.plant import Plant
    from ccr_host.tools.front_door import Robot, Run, load_run, open_robot
    from ccr_host.tracking.tracker import MarkerFrame, Pose, RawTracker, TrackerHealth

_HOME = {
    "core": ("__version__",),
    "control.base": ("Command", "Controller", "Observation", "Outcome"),
    "description.schema": ("Description",),
    "run.observer": ("RunObserver",),
    "sim.robot.plant": ("Plant",),
    "tools.front_door": ("Robot", "Run", "load_run", "open_robot"),
    "tracking.tracker": ("MarkerFrame", "Pose", "RawTracker", "TrackerHealth"),
}
"""Module of each name that is imported late."""

__all__ = [
    "CcrError",
    "CodeError",
    "Command",
    "ConfigError",
    "Controller",
    "Description",
    "DeviceError",
    "MarkerFrame",
    "Observation",
    "Outcome",
    "Plant",
    "Pose",
    "RawTracker",
    "Robot",
    "Run",
    "RunObserver",
    "TrackerError",
    "TrackerHealth",
    "__version__",
    "load_run",
    "open_robot",
]


def __getattr__(name: str) -> object:
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"ccr_host.{module}"), name)
    raise AttributeError(f"module ccr_host has no attribute {name}")


def __dir__() -> list[str]:
    return __all__
