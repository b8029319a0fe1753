"""Fit the static model to a tour of rests: regularised, robust least squares."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.motion import first_rest, moved
from ccr_host.control.adaptive.parameters import COUNT, Parameters, parameters_of, prior_of
from ccr_host.control.adaptive.tip import markers_mm
from ccr_host.description.schema import Description, Robot, Tracker

FloatArray = NDArray[np.float64]

_ITERATIONS = 20
_DAMPING_FIRST, _DAMPING_FALL, _DAMPING_RISE, _DAMPING_MOST = 1e-3, 0.1, 10.0, 1e3
_PROBE = 1e-4
_DONE = 1e-2
"""Of a prior deviation: smaller steps of the fit end it."""
_HUBER_DEVIATIONS = 3.0
_RINGING_MM = 0.32
"""Of a coordinate of one measurement at rest, beside the camera's noise."""
_MODEL_MM = 0.25
"""Of a coordinate of a rest, however often it was measured: what the model leaves is alike in
neighbouring rests, so that to believe it less than it seems to be is not enough."""
_SURPRISING = 2.5
"""Residual over expected residual at which the model does not explain the robot; 0.85 at most in
the tours of 40 random robots (`bench.misfits.matching`)."""
TURNS = [Parameters._fields.index(f"turn_{axis}_rad") for axis in "xyz"]
ZEROS = [Parameters._fields.index(f"zero_{motor}_rad") for motor in (1, 2)]
PUSHES = [Parameters._fields.index(name) for name in ("push_x_per_mm", "push_y_per_mm")]
"""A robot at rest is taken to be pushed by nothing: pushes look like a turned camera."""
_USUAL_TURN_DEG = 0.5
"""Standard deviation of a registration that does not state it."""
_LEAST_TURN_DEG = 0.1
_FREE_ZERO_RAD = 0.8
"""Where zeros are looked for: the horn of a servo fits on its spline every 14.4 deg."""


@dataclass(frozen=True)
class Fit:
    """Parameters in prior deviations from the prior mean.

    ``score`` (COUNT,), ``covariance`` (COUNT, COUNT), ``rms_mm`` of the markers that the fit
    leaves, and what noise and the model's usual error let expect of it; ``cost`` is what it has
    minimised: squared standardised residuals, as far as they count, and squared scores.
    """

    score: FloatArray
    covariance: FloatArray
    rms_mm: float
    expected_rms_mm: float
    cost: float

    @property
    def explains(self) -> bool:
        """Whether the model explains the rests: leaves no more than noise and its usual error."""
        return self.rms_mm < _SURPRISING * self.expected_rms_mm

    @property
    def residual(self) -> str:
        """What the fit leaves, in words."""
        verdict = "" if self.explains else ": it does not explain the robot"
        return (
            f"the model leaves {self.rms_mm:.2f} mm RMS, where the camera's noise and its usual "
            f"error make {self.expected_rms_mm:.2f}{verdict}"
        )


@dataclass(frozen=True)
class Rests:
    """Rests in the order in which the robot came to them, straight from one to the next.

    ``setpoint_rad`` (N, 2); ``markers_mm`` (N, 2, 3), M2 and M3 against M1, is the mean of
    ``count`` (N,) measurements, NaN where a marker was not seen; ``start_rad`` (2,) is where the
    robot came from.
    """

    start_rad: FloatArray
    setpoint_rad: FloatArray
    markers_mm: FloatArray
    count: FloatArray

    @property
    def tip_mm(self) -> FloatArray:
        """M3 against M1, (N, 3)."""
        return self.markers_mm[:, 1]


class Scaling:
    """Parameters as scores, (parameter - prior mean) / prior deviation, and their bounds.

    Args:
        robot: what the prior knows.
        turn_deviation_rad: of the camera's rotation, about each axis or about x, y and z, (3,),
            where it was registered.
        zero_deviation_rad: of the servos' zeros, where they are believed otherwise.
        noise_mm: RMS length of the error of a measured vector between two markers.
    """

    def __init__(
        self,
        robot: Robot,
        turn_deviation_rad: FloatArray | float | None = None,
        zero_deviation_rad: float | None = None,
        noise_mm: float = Tracker().noise_mm,
    ) -> None:
        prior = prior_of(robot)
        self._noise_mm = math.hypot(_RINGING_MM, noise_mm / math.sqrt(3.0))
        self._mean, self._deviation = prior.mean, prior.deviation
        if turn_deviation_rad is not None:
            self._deviation[TURNS] = turn_deviation_rad
        if zero_deviation_rad is not None:
            self._deviation[ZEROS] = zero_deviation_rad
            prior.lower[ZEROS], prior.upper[ZEROS] = -_FREE_ZERO_RAD, _FREE_ZERO_RAD
        self._lower = (prior.lower - prior.mean) / self._deviation
        self._upper = (prior.upper - prior.mean) / self._deviation

    @classmethod
    def of(cls, description: Description) -> Scaling:
        """Believes a registered camera's rotation as precisely as its registration states."""
        registration, noise_mm = description.registration, description.tracker.noise_mm
        if registration is None:
            return cls(description.robot, noise_mm=noise_mm)
        stated_deg = registration.uncertainty_deg or _USUAL_TURN_DEG
        turn_rad = np.radians(np.maximum(stated_deg, _LEAST_TURN_DEG))
        return cls(description.robot, turn_rad, noise_mm=noise_mm)

    def deviation_mm(self, count: FloatArray) -> FloatArray:
        """Standard deviation of a coordinate of rests that were measured ``count`` times, (N,)."""
        deviation_mm: FloatArray = np.hypot(self._noise_mm / np.sqrt(count), _MODEL_MM)
        return deviation_mm

    def parameters(self, score: FloatArray) -> Parameters:
        """Floats for the model."""
        return parameters_of(self._mean + self._deviation * score)

    def perturbed(self, score: FloatArray, probe: float) -> Parameters:
        """Each score raised by ``probe`` in turn, and at last none: arrays (COUNT + 1,)."""
        scores = score + probe * np.eye(COUNT + 1, COUNT)
        return Parameters(*(self._mean + self._deviation * scores).T)

    def freed(self, indices: Sequence[int], factor: float) -> Scaling:
        """Some parameters are believed so many times less, and may go so much further."""
        other = copy.copy(self)
        lower, upper = (self._mean + self._deviation * end for end in (self._lower, self._upper))
        other._deviation = self._deviation.copy()
        for index in indices:
            mean = self._mean[index]
            other._deviation[index] *= factor
            upper[index] = mean + factor * (upper[index] - mean)
            lower[index] *= factor if mean == 0.0 else 0.5
        other._lower = (lower - other._mean) / other._deviation
        other._upper = (upper - other._mean) / other._deviation
        return other

    def bounded(self, score: FloatArray) -> FloatArray:
        """The nearest scores with a meaning."""
        return np.clip(score, self._lower, self._upper)


Predict = Callable[[Parameters, Rests], FloatArray]


class StaticsFit:
    """Levenberg and Marquardt's method, one step at a time.

    A step takes tenths of a second, during which the board must go on hearing from the host.

    Args:
        scaling: prior.
        rests: what was measured.
        predict: instead of ``predicted_mm``.
        start: scores to begin with, (COUNT,); the prior's without.
    """

    def __init__(
        self,
        scaling: Scaling,
        rests: Rests,
        predict: Predict | None = None,
        start: FloatArray | None = None,
    ) -> None:
        self._predict = predict or predicted_mm
        self.scaling = scaling
        self.rests = rests
        self._seen = np.isfinite(rests.markers_mm).all(axis=-1).ravel()
        self._weight = 1.0 / np.repeat(scaling.deviation_mm(rests.count), 2)[self._seen, None]
        self._score = np.zeros(COUNT) if start is None else start
        self._residual_mm, self._cost = self._judge(self._score)
        self._information = np.eye(COUNT)
        self._damping = _DAMPING_FIRST
        self._steps_left = _ITERATIONS

    def improve(self) -> bool:
        """Make a step; whether another one may be worth it."""
        scaled = self._residual_mm * self._weight
        slope = self._sensitivity() * self._weight[..., None]
        weighted = slope * _huber_weight(scaled)[:, None, None]
        self._information = np.einsum("nip,niq->pq", weighted, slope) + np.eye(COUNT)
        gradient = np.einsum("nip,ni->p", weighted, scaled) - self._score
        self._steps_left -= 1
        return self._descend(gradient) > _DONE and self._steps_left > 0

    def finish(self) -> Fit:
        """All steps that are left at once."""
        while self.improve():
            pass
        return self.result()

    def result(self) -> Fit:
        """What has been found so far."""
        rms_mm = float(np.sqrt((self._residual_mm**2).sum(axis=1).mean()))
        expected_mm = math.sqrt(3.0 * float((self._weight**-2.0).mean()))
        covariance = np.asarray(np.linalg.inv(self._information), dtype=np.float64)
        return Fit(self._score, covariance, rms_mm, expected_mm, self._cost)

    def _descend(self, gradient: FloatArray) -> float:
        """Damp the step until it leads downhill; its length, 0 if none does."""
        while self._damping < _DAMPING_MOST:
            damped = self._information + self._damping * np.diag(np.diag(self._information))
            trial = self.scaling.bounded(self._score + np.linalg.solve(damped, gradient))
            residual_mm, cost = self._judge(trial)
            if cost < self._cost:
                length = float(np.abs(trial - self._score).max())
                self._score, self._residual_mm, self._cost = trial, residual_mm, cost
                self._damping *= _DAMPING_FALL
                return length
            self._damping *= _DAMPING_RISE
        return 0.0

    def _judge(self, score: FloatArray) -> tuple[FloatArray, float]:
        predicted = self._predict(self.scaling.parameters(score), self.rests)
        residual_mm = (self.rests.markers_mm - predicted).reshape(-1, 3)[self._seen]
        return residual_mm, _cost(residual_mm * self._weight, score)

    def _sensitivity(self) -> FloatArray:
        """d marker / d score of each that was seen, (M, 3, COUNT), the way to it included."""
        near_mm = self._predict(self.scaling.perturbed(self._score, _PROBE), self.rests)
        slope = np.moveaxis(near_mm[:, :COUNT] - near_mm[:, COUNT:], 1, -1) / _PROBE
        slope[..., PUSHES] = 0.0
        return slope.reshape(-1, 3, COUNT)[self._seen]


def predicted_mm(p: Parameters, rests: Rests) -> FloatArray:
    """M2 and M3 at the rests, (N, ..., 2, 3), for parameters that are floats or arrays (...)."""
    shape = np.shape(p.gain_1)
    rest = first_rest(p, np.broadcast_to(rests.start_rad, (*shape, 2)))
    markers = []
    for setpoint in rests.setpoint_rad:
        rest = moved(p, rest, np.broadcast_to(setpoint, (*shape, 2)))
        markers.append(markers_mm(p, rest.theta_rad))
    return np.array(markers)


def _cost(standardised: FloatArray, score: FloatArray) -> float:
    size = np.linalg.norm(standardised, axis=1)
    excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
    return float((size**2 - excess**2).sum() + (score**2).sum())


def _huber_weight(standardised: FloatArray) -> FloatArray:
    size = np.linalg.norm(standardised, axis=1)
    weight: FloatArray = _HUBER_DEVIATIONS / np.maximum(size, _HUBER_DEVIATIONS)
    return weight
