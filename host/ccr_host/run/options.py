"""The options of a rig, and of a run on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.sim.robot.plant import TWIN


@dataclass(frozen=True, kw_only=True)
class RigOptions:
    """Which robot, board and tracker; small and picklable, for use in other processes.

    Raises:
        ConfigError: a seed below 0.
    """

    robot: str | None = None
    overrides: tuple[str, ...] = ()
    device: str = "emulator:"
    tracker: str = "twin:"
    plant: str = TWIN
    """The simulated robot, if the tracker sees one."""
    seed: int = 1
    realtime: bool = False

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed {self.seed}: negative", "give 0 or more")

    def description(self) -> Description:
        """Robot description with the overrides applied.

        Raises:
            ConfigError: see :func:`ccr_host.description.schema.load`.
        """
        return schema.load(self.robot, self.overrides)


Checks = Literal["none", "markers", "motion"]
"""Check nothing, that the markers fit, or also that the robot moves as described."""


SurfaceName = Literal["model", "robot"]
"""Whose third coordinate a lateral path gets: that of (10), or that of the identified robot."""


@dataclass(frozen=True)
class RunOptions(RigOptions):
    """The complete options of a run.

    Raises:
        ConfigError: a seed below 0, no lap, or an unknown surface.
    """

    path: str
    controller: str = "adaptive"
    rate_hz: float = 1.0
    laps: int = 1
    checks: Checks = "markers"
    """What is checked before the path and along it."""
    surface: SurfaceName = "model"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.laps < 1:
            raise ConfigError(f"{self.laps} laps: none to run", "give 1 or more")
        if self.surface not in get_args(SurfaceName):
            raise ConfigError(f"surface {self.surface}: unknown", "give model or robot")

    @property
    def effective_checks(self) -> Checks:
        """The checks that are possible: recorded markers do not respond to commands."""
        recorded = self.checks == "motion" and self.tracker.startswith("replay:")
        return "markers" if recorded else self.checks

    @property
    def on_surface(self) -> str:
        """Addition to a title; empty for the usual surface."""
        return "" if self.surface == "model" else f", on the surface of the {self.surface}"

    def with_controller(self, controller: str) -> RunOptions:
        """The same run under another controller."""
        return replace(self, controller=controller)

    def on_the_twin(self) -> RunOptions:
        """The same run on the emulated board and the twin, in virtual time."""
        return replace(self, device="emulator:", tracker="twin:", realtime=False)
