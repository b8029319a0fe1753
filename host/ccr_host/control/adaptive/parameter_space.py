"""Parameters of a static model as scores: prior deviations from the prior mean, with bounds."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.simulation import Tracker

FloatArray = NDArray[np.float64]
P = TypeVar("P")

_RINGING_MM = 0.32
"""Error of a coordinate of a measurement at rest, in addition to the camera's noise."""
_MODEL_MM = 0.25
"""Assumed error of a coordinate of a rest, however often it was measured: larger than the model's
residual, as its errors are correlated in neighbouring rests."""
_SHAFT_RAD = math.radians(0.5)
"""Deadband, backlash, droop, creep and friction of cheap parts make some tenths of a degree."""


class Prior(NamedTuple):
    """Mean, standard deviation and bounds of each parameter, (COUNT,)."""

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray


class Roles(NamedTuple):
    """Numbers of the parameters that are not learnt like the others."""

    drifting: list[int]
    """They change during a run: threads creep."""
    hindrances: list[int]
    """Backlash and friction, which drift too; small ones count as absent, so that noise on the path
    cannot add them."""
    loads: list[int]
    """What is freed when a load on the tip begins suddenly."""
    pushes: list[int]
    """No push is assumed on a robot at rest, as a push looks like a turned camera."""


class ParameterSpace(ABC, Generic[P]):
    """The parameters of a robot as scores, (parameter - prior mean) / prior deviation.

    Args:
        prior: mean, deviation and bounds.
        roles: which parameters are not learnt like the others.
        noise_mm: RMS length of the error of a measured vector between two markers.
    """

    believable_mm = 60.0
    """Median distance of rests from the prior from which they are not fitted. Random robots of the
    paper's kind are 10 to 30 mm off the prior; confused markers are further off."""

    def __init__(self, prior: Prior, roles: Roles, noise_mm: float = Tracker().noise_mm) -> None:
        self.roles = roles
        self.shaft_rad = _SHAFT_RAD
        """Unexplained shaft angle of a rest."""
        self._noise_mm = math.hypot(_RINGING_MM, noise_mm / math.sqrt(3.0))
        self._mean, self.deviation = prior.mean, prior.deviation
        self._lower = (prior.lower - prior.mean) / self.deviation
        self._upper = (prior.upper - prior.mean) / self.deviation

    @property
    def count(self) -> int:
        """Number of parameters."""
        return len(self.deviation)

    @abstractmethod
    def parameters(self, score: FloatArray) -> P:
        """The parameters of scores, (COUNT,)."""

    @abstractmethod
    def perturbed(self, score: FloatArray, probe: float) -> P:
        """Parameters with each score increased by ``probe`` in turn, then none: COUNT + 1 sets."""

    @abstractmethod
    def by_shaft(self, shaft_rad: float) -> FloatArray:
        """Scores that move the robot as this angle of each motor's shaft does, (COUNT, n)."""

    def priors(self) -> Sequence[Self]:
        """The priors under which a robot is fitted; the most likely fit counts."""
        return (self,)

    def deviation_mm(self, count: FloatArray) -> FloatArray:
        """Standard deviation of a coordinate of rests that were measured ``count`` times, (N,)."""
        deviation_mm: FloatArray = np.hypot(self._noise_mm / np.sqrt(count), _MODEL_MM)
        return deviation_mm

    def bounded(self, score: FloatArray) -> FloatArray:
        """The nearest scores within the bounds."""
        return np.clip(score, self._lower, self._upper)
