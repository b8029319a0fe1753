"""Jacobian feedback with Broyden's rank-one update.

As in uncalibrated visual servoing (Jagersand, Fuentes, Nelson, ICRA 1997); the least change of J
that explains a motion, as Yip and Camarillo estimate it (IEEE T-RO 30(4), 2014), is Broyden's
update as long as no constraint is active.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.baselines.jacobian_feedback import JacobianFeedback, Tuning
from ccr_host.control.baselines.loop import PeerLoop
from ccr_host.description.schema import Description

FloatArray = NDArray[np.float64]


class BroydenEstimator:
    """J += rate (dx - J dq) dq' / (dq'dq + regularisation^2).

    Args:
        rate: 1 meets the newest secant, less smooths over several.
        regularisation_rad: turns well below it change J little.
    """

    jacobian_mm_rad: FloatArray

    def __init__(self, rate: float = 0.5, regularisation_rad: float = 0.03) -> None:
        self._rate = rate
        self._regularisation_rad = regularisation_rad

    def start(self, guess_mm_rad: FloatArray) -> None:
        self.jacobian_mm_rad = guess_mm_rad

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        unexplained_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        weight = self._rate / (turn_rad @ turn_rad + self._regularisation_rad**2)
        self.jacobian_mm_rad = self.jacobian_mm_rad + weight * np.outer(unexplained_mm, turn_rad)


class Broyden(PeerLoop):
    """See the module."""

    name = "broyden"

    def __init__(self, description: Description) -> None:
        super().__init__(description, JacobianFeedback(description, BroydenEstimator(), Tuning()))
