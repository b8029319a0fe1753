"""What a rig, and a run on it, can be told."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ccr_host import config
from ccr_host.config import Description
from ccr_host.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class RigOptions:
    """Which robot, board and tracker; small and picklable, so that other processes can have it.

    Raises:
        ConfigError: a seed below 0.
    """

    robot: str | None = None
    overrides: tuple[str, ...] = ()
    device: str = "emulator:"
    tracker: str = "twin:"
    seed: int = 1
    realtime: bool = False

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed {self.seed}: negative", "give 0 or more")

    def description(self) -> Description:
        """Robot description with the overrides applied.

        Raises:
            ConfigError: see :func:`ccr_host.config.load`.
        """
        return config.load(self.robot, self.overrides)


@dataclass(frozen=True)
class RunOptions(RigOptions):
    """One run, fully determined.

    Raises:
        ConfigError: a seed below 0, or no lap.
    """

    path: str
    controller: str = "adaptive"
    rate_hz: float = 1.0
    laps: int = 1
    checked: bool = False
    """Whether the robot has to move as described, before the path and along it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.laps < 1:
            raise ConfigError(f"{self.laps} laps: none to run", "give 1 or more")

    @property
    def is_checked(self) -> bool:
        """Whether the robot is looked at; recorded markers answer to no command."""
        return self.checked and not self.tracker.startswith("replay:")

    def with_controller(self, controller: str) -> RunOptions:
        """The same run under another controller."""
        return replace(self, controller=controller)

    def on_the_twin(self) -> RunOptions:
        """The same run on the emulated board and the twin, in virtual time."""
        return replace(self, device="emulator:", tracker="twin:", realtime=False)
