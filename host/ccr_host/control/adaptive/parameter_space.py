"""Parameters of a static model as scores: prior deviations from the prior mean, with bounds."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.description.simulation import Tracker

P = TypeVar("P")
Gravity = tuple[float, float, float]
"""Direction of gravity in the frame of (10)."""

_RINGING_MM = 0.32
"""Error of a coordinate of a measurement at rest, in addition to the camera's noise."""
_MODEL_MM = 0.25
"""Assumed error of a coordinate of a rest, however often it was measured: larger than the model's
residual, as its errors are correlated in neighbouring rests."""
BEFORE_SETUP_TURN_RAD = 0.3
"""Standard deviation of the camera's turn about the frame that the fit to a new robot starts
from."""
BEFORE_SETUP_ZERO_RAD = math.radians(30.0)
"""Standard deviation of the zeros of a new robot's servos."""
_SHAFT_RAD = math.radians(0.5)
"""Deadband, backlash, droop, creep and friction of cheap parts make some tenths of a degree."""


class Prior(NamedTuple):
    """Mean, standard deviation and bounds of each parameter, (COUNT,)."""

    mean: Array
    deviation: Array
    lower: Array
    upper: Array


class Roles(NamedTuple):
    """Numbers of the parameters that are not learnt like the others."""

    drifting: list[int]
    """They change during a run: threads creep."""
    hindrances: list[int]
    """Backlash and friction, which drift too; small ones count as absent, so that noise on the path
    cannot add them."""
    warming: list[int]
    """Zeros of servos, which drift as they warm up."""
    loads: list[int]
    """What is freed when a load on the tip begins suddenly."""
    pushes: list[int]
    """No push is assumed on a robot at rest, as a push looks like a turned camera."""
    varying: list[int]
    """They vary beyond their prior from robot to robot: loads, stiffness, friction, glue."""
    turns: list[int]
    """The camera's turn about x, y and z; none where it is believed."""


class Mounting(NamedTuple):
    """How segments, servos and tendons of a robot are found to be."""

    lengths_mm: Array
    """Length of each segment, (S,)."""
    take_up_rad: Array
    """Motor angle that takes up the slack of a straight segment, (n,)."""
    gain: Array
    """Bending over motor angle with taut tendons, (n,); r_p / r_c in the description."""


class ParameterSpace(ABC, Generic[P]):
    """The parameters of a robot as scores, (parameter - prior mean) / prior deviation.

    ``noise_mm`` is the RMS length of the error of a measured vector between two markers.
    """

    believable_mm = 60.0
    """Median distance of rests from the prior from which they are not fitted. Random robots of the
    paper's kind are 10 to 30 mm off the prior; confused markers are further off."""

    most_deviations = 3.3
    """Deviations by which rests contradict what is described. Of 160 random robots that match their
    RMS is 0.5 to 0.9; if they are normal, one of a dozen parameters is further off in one robot of
    a thousand (bench/results.md)."""

    most_surprise = 1.4
    """Ratio of residual to expected residual above which the model does not explain the robot. Its
    logarithm, if normal, is greater in one of 2000 random robots that match."""

    varying_by = 1.0
    """Deviation of parameters that vary from robot to robot, over that of their prior."""

    farther_moves_tell = False
    """Whether the model is good enough for farther moves to decide where few rests do not."""

    doubt = 0.0
    """Twice the logarithm of the odds against this prior, before any measurement."""

    inflation = 2.0
    """Factor of the variances that rests leave, as errors of the model are alike in neighbouring
    ones (bench/results.md)."""

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
        return len(self.deviation)

    @abstractmethod
    def parameters(self, score: Array) -> P:
        """The parameters of scores, (COUNT,)."""

    def perturbed(self, score: Array, probe: float) -> P:
        """Parameters with each score increased by ``probe`` in turn, then none: COUNT + 1 sets."""
        return self.each(score + probe * np.eye(self.count + 1, self.count))

    @property
    @abstractmethod
    def names(self) -> Sequence[str]:
        """Names of the parameters, with units."""

    @property
    @abstractmethod
    def zero_rad(self) -> Array:
        """Zero of each servo over the scores, (n, COUNT): the setpoint at which the shaft is at 0.

        Different slack of the tendons of a segment has the same effect.
        """

    @abstractmethod
    def mounting(self, score: Array) -> Mounting:
        """What scores, (COUNT,), say about segments, servos and tendons."""

    @abstractmethod
    def each(self, scores: Array) -> P:
        """The parameters of several sets of scores, (K, COUNT)."""

    @abstractmethod
    def starts(self) -> Array:
        """Scores from which the fit to a robot before its setup may start, (K, M, COUNT).

        Of each K the nearest one of M is tried.
        """

    has_modes = False
    """Whether a fit may be one of several, so that all starts are tried for few rests."""

    def few_starts(self) -> Array:
        """Scores from which to fit, (K, COUNT), the prior first, until a fit explains the rests."""
        return np.zeros((1, self.count))

    def mountings(self) -> Mapping[Gravity, Self]:
        """The same robot under other directions of gravity that its rests can tell apart."""
        return {}

    def of_few_rests(self) -> ParameterSpace[P]:
        """The prior for the few rests before a path, of a robot that may not be as described."""
        return self

    def values(self, score: Array) -> Array:
        """The parameters as a vector, (COUNT,)."""
        return np.asarray(self._mean + self.deviation * score)

    def zeros_deviation_rad(self, covariance: Array) -> Array:
        """Standard deviation of the servos' zeros, (n,), by that of the scores."""
        by_score = self.zero_rad
        deviation: Array = np.sqrt(np.einsum("ni,ij,nj->n", by_score, covariance, by_score))
        return deviation

    @abstractmethod
    def by_shaft(self, shaft_rad: float) -> Array:
        """Scores that move the robot as this angle of each motor's shaft does, (COUNT, n)."""

    def priors(self) -> Sequence[Self]:
        """The priors under which a robot is fitted; the most likely fit counts."""
        return (self,)

    def aligned(self) -> Self | None:
        """The prior of a camera that is aligned with the robot; None if more is known of it."""
        return None

    def deviation_mm(self, count: Array) -> Array:
        """Standard deviation of a coordinate of rests that were measured ``count`` times, (N,)."""
        return np.hypot(self._noise_mm / np.sqrt(count), _MODEL_MM)

    def bounded(self, score: Array) -> Array:
        """The nearest scores within the bounds."""
        return np.clip(score, self._lower, self._upper)

    def are_held(self, score: Array, uphill: Array) -> BoolArray:
        """Whether a bound keeps each score from going this way, (COUNT,) all."""
        held: BoolArray = (score <= self._lower) & (uphill < 0.0)
        return held | ((score >= self._upper) & (uphill > 0.0))
