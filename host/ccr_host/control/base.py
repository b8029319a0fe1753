"""The interface of every controller.

One alignment holds for all of them: the command of step i is given at the start of period i and
aims at ``reference.target_mm[i]``; the observation it rests on was made at the end of period
i - 1.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.robot.reference import Reference


class Outcome(enum.Enum):
    """How a command came about."""

    SOLVED = "solved"
    """Computed from a fresh measurement, or by a controller that needs none."""
    COASTED = "coasted"
    """No measurement: computed from the model alone."""
    HELD = "held"
    """The solver failed: the last safe command, repeated."""
    SKIPPED = "skipped"
    """No command was sent: its time had passed when the host resumed."""


@dataclass(frozen=True)
class Picture:
    """A measurement of the tip that is older than the newest one."""

    tip_mm: Array
    """Measured tip f_m, (3,)."""
    age_us: int
    """Time from the exposure to ``Observation.time_us``."""
    ends_mm: Array
    """Ends of the segments relative to M1, (S, 3); NaN where not seen. The last one is the tip."""


@dataclass(frozen=True)
class Observation:
    """The inputs of a controller at a control step."""

    step: int
    """Index of the command to give, from 1; step 0 is ``Controller.start``."""
    time_us: int
    """Time of the run's clock."""
    tip_mm: Array | None
    """Newest measured tip f_m, (3,); None if there is none fresh enough."""
    tip_age_us: int
    """Time from the exposure of ``tip_mm`` to ``time_us``; 0 without a tip."""
    q_rad: Array
    """Motor angles commanded last, as the board accepted them, (motors,)."""
    ends_mm: Array = field(default_factory=lambda: np.full((1, 3), np.nan))
    """Ends of the segments relative to M1 in the picture of ``tip_mm``, (S, 3); NaN where not seen.
    The last one is the tip."""
    earlier: tuple[Picture, ...] = ()
    """The other pictures since the last call, oldest first, without those that cannot show this
    robot: 19 of a camera of 20 Hz at 1 Hz. There may be some when ``tip_mm`` is None."""


@dataclass(frozen=True)
class Phase:
    """What a run is doing, shown to waiting users."""

    name: str
    done: float | None = None
    """Share of the phase that is done, 0 to 1; None if unknown."""


@dataclass(frozen=True)
class Command:
    """Motor angles to move to, and the motion that the controller predicts."""

    q_rad: Array
    """(motors,), within their limits."""
    predicted_mm: Array
    """Predicted tip at the end of this period and of any further planned ones, (k, 3)."""
    outcome: Outcome
    detail: str = field(default="")
    """Why it was held, or another remark for the log."""
    ramp_s: float = 0.0
    """Duration of the setpoint's linear motion to ``q_rad``; 0 for a step."""
    iterations: int | None = None
    """Number of solver iterations; None without a solver."""
    phase: Phase | None = None
    """What an approach is doing at the moment; None if it has only one phase."""


class Controller(Protocol):
    """Follows one reference, one command per control period."""

    def start(self, reference: Reference) -> Command:
        """Begin a reference and return the command of step 0, q_1 = f^-1(f_1)."""
        ...

    def step(self, observation: Observation) -> Command:
        """Return the command of step ``observation.step``, 1 to len(reference) - 1."""
        ...


@runtime_checkable
class Approaching(Protocol):
    """A controller that approaches the first point under feedback, before the path's clock."""

    def approach(self, observation: Observation) -> Command | None:
        """Return the next command of the approach, or None once the path may begin.

        Called after ``start``, every ``APPROACH_PERIOD_S``; step 0 then comes from ``step``.
        """
        ...


APPROACH_PERIOD_S = 0.05
"""Time between two commands of an approach."""


LONGEST_RAMP_S = 10.0
"""The longest ramp that the protocol can carry."""


def checked(answer: object, motors: int) -> Command:
    """Validate a controller's answer and convert its numbers to arrays.

    Raises:
        ValueError: it is not a command, or cannot be executed; limits are not checked.
    """
    if not isinstance(answer, Command):
        raise ValueError(f"{type(answer).__name__} instead of a Command")
    if not isinstance(answer.outcome, Outcome):
        raise ValueError(f"outcome {answer.outcome!r} instead of an Outcome")
    if not 0.0 <= answer.ramp_s <= LONGEST_RAMP_S:
        raise ValueError(f"ramp_s = {answer.ramp_s}, which is not in 0..{LONGEST_RAMP_S:g}")
    arrays: list[Array] = []
    for name in ("q_rad", "predicted_mm"):
        numbers = getattr(answer, name)
        try:
            array = np.asarray(numbers).astype(np.float64, casting="same_kind")
        except (TypeError, ValueError):
            raise ValueError(f"{name} = {numbers!r} instead of numbers") from None
        if not all(map(math.isfinite, array.flat)):
            raise ValueError(f"{name} = {array.tolist()}, which is not finite")
        arrays.append(array)
    q_rad, predicted_mm = arrays
    if q_rad.shape != (motors,):
        raise ValueError(f"q_rad of shape {q_rad.shape} instead of {(motors,)}")
    if predicted_mm.shape[1:] != (3,):
        raise ValueError(f"predicted_mm of shape {predicted_mm.shape} instead of (k, 3)")
    return replace(answer, q_rad=q_rad, predicted_mm=predicted_mm)
