"""The interface of every controller.

One alignment holds for all of them: the command of step i is given at the start of period i and
aims at ``reference.target_mm[i]``; the observation it rests on was made at the end of period
i - 1.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.reference import Reference

FloatArray = NDArray[np.float64]


class Outcome(enum.Enum):
    """How a command came about."""

    SOLVED = "solved"
    """From a fresh measurement, or by a controller that needs none."""
    COASTED = "coasted"
    """No measurement: from the model alone."""
    HELD = "held"
    """The solver failed: the last safe command, repeated."""


@dataclass(frozen=True)
class Observation:
    """What a controller knows when it has to give a command."""

    step: int
    """Index of the command to give, from 1; step 0 is ``Controller.start``."""
    time_us: int
    """Time of the run's clock."""
    tip_mm: FloatArray | None
    """Newest measured tip f_m, (3,); None if there is none fresh enough."""
    tip_age_us: int
    """From the exposure of ``tip_mm`` to ``time_us``; 0 without one."""
    q_rad: FloatArray
    """Motor angles commanded last, as the board accepted them, (2,)."""


@dataclass(frozen=True)
class Command:
    """Motor angles to go to, and what the controller expects of them."""

    q_rad: FloatArray
    """(2,), within the motor limits."""
    predicted_mm: FloatArray
    """Tip at the ends of this period and the following ones as far as planned, (k, 3)."""
    outcome: Outcome
    detail: str = field(default="")
    """Why it was held, or what else is worth a line in the log."""
    ramp_s: float = 0.0
    """How long the setpoint takes to ``q_rad``, in a straight line; 0 for a step."""
    iterations: int | None = None
    """Of the solver, where there is one."""


class Controller(Protocol):
    """Follows one reference, one command per control period."""

    name: str

    def start(self, reference: Reference) -> Command:
        """Take over a reference; the command of step 0, q_1 = f^-1(f_1)."""
        ...

    def step(self, observation: Observation) -> Command:
        """The command of step ``observation.step``, 1 to len(reference) - 1."""
        ...


@runtime_checkable
class Approaching(Protocol):
    """A controller that approaches the first point under feedback, before the path's clock."""

    def approach(self, observation: Observation) -> Command | None:
        """The next command of the approach, None once the path may begin.

        Called after ``start``, every ``APPROACH_PERIOD_S``; step 0 then comes from ``step``.
        """
        ...


APPROACH_PERIOD_S = 0.05
"""Between two commands of an approach."""
