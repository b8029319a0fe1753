"""The options of a rig, and of a run on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from numbers import Integral, Real
from types import NoneType
from typing import Any, Literal, get_args

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.sim.robot.plant import TWIN

_KINDS: dict[str, tuple[str, Any, Callable[[Any], object]]] = {
    "str": ("text", str, lambda text: text),
    "str | None": ("text", str | NoneType, lambda text: text),
    "int": ("a whole number", Integral, int),
    "float": ("a number", Real, float),
}
"""What programs may mix up, by annotation: in words, what is accepted, and what it is kept as."""


@dataclass(frozen=True, kw_only=True)
class RigOptions:
    """Which robot, board and tracker; small and picklable, for use in other processes.

    Raises:
        ConfigError: an option of another kind, or a seed below 0.
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
        for option in fields(self):
            value = getattr(self, option.name)
            if (kind := _KINDS.get(str(option.type))) is None:
                continue
            what, accepted, kept_as = kind
            if isinstance(value, bool) or not isinstance(value, accepted):
                raise ConfigError(f"{option.name} = {value!r}: not {what}", f"give {what}")
            object.__setattr__(self, option.name, kept_as(value))  # no numpy number, for JSON
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
        ConfigError: an option of another kind, a seed below 0, no lap, or an unknown surface.
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
