"""Identification: what is measured at rests, and the fit of a static model to it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic

import numpy as np

from ccr_host.control.adaptive.parameter_space import P, ParameterSpace
from ccr_host.control.adaptive.static_model import StaticModel
from ccr_host.control.shell import Measurement, median_of_seen
from ccr_host.core.arrays import Array, BoolArray
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory

_ITERATIONS = 20
_DAMPING_FIRST, _DAMPING_FALL, _DAMPING_RISE, _DAMPING_MOST = 1e-3, 0.1, 10.0, 1e3
_DONE = 1e-2
"""The fit ends when its steps are shorter than this fraction of a prior deviation."""
_HUBER_DEVIATIONS = 3.0
_UNSEEN_MM = 1e6
"""Standard deviation of a marker that was not seen."""

SETTLED_AFTER_S = 0.15
"""Time after which a tip counts as resting when its servos rest."""
_FEWEST_RESTS = 10


@dataclass(frozen=True)
class Fit:
    """Parameters in prior deviations from the prior mean.

    ``score`` (COUNT,), ``covariance`` (COUNT, COUNT), ``rms_mm`` of the markers' residuals;
    ``stands_out`` (N,): rests with a residual of more than three of its standard deviations;
    ``surprise``: RMS of the residuals over their standard deviations from noise, unexplained shaft
    angles and the model's usual error; ``cost``: minus twice the log likelihood, up to a constant,
    of the rests (robust) and the scores. Of two rests at one pose, reached from either side, the
    residuals are those of their mean.
    """

    score: Array
    covariance: Array
    rms_mm: float
    stands_out: BoolArray
    surprise: float
    cost: float

    @property
    def evidence(self) -> float:
        """Twice the log probability of the rests under the whole prior, up to a constant.

        By Laplace's method: a wider prior has to pay for its width by smaller residuals.
        """
        return float(np.linalg.slogdet(self.covariance)[1]) - self.cost

    @property
    def explains(self) -> bool:
        """Whether the model explains the rests."""
        return self.surprise < ParameterSpace.most_surprise

    @property
    def residual(self) -> str:
        """The residual of the fit, in words."""
        verdict = "" if self.explains else ": it does not explain the robot"
        return (
            f"the model leaves {self.rms_mm:.2f} mm RMS, {self.surprise:.1f} times what noise and "
            f"usual errors make{verdict}"
        )


class StaticsFit(Generic[P]):
    """Fit by Levenberg and Marquardt's method, one step at a time.

    Rests whose residuals are small are then fitted again, with smaller unexplained angles.

    A step takes tenths of a second; between steps the host must send commands to the board. It
    starts at the scores ``start``, (COUNT,); by default at those of the prior.
    """

    def __init__(
        self,
        scaling: ParameterSpace[P],
        rests: Rests,
        model: StaticModel[P, Any],
        start: Array | None = None,
    ) -> None:
        self._model = model
        self.scaling = scaling
        self.rests = rests
        seen = np.all(np.isfinite(rests.vectors_mm), axis=-1, keepdims=True)
        self._contrasts, are_differences = _contrasts_of(rests, seen)
        self._vectors_mm = self._contrast(np.where(seen, rests.vectors_mm, 0.0))
        measured_mm = scaling.deviation_mm(rests.count)[:, None, None]
        deviation_mm = np.where(seen, measured_mm, _UNSEEN_MM).repeat(3, axis=-1)
        hysteresis_mm2 = np.mean(self._vectors_mm**2, axis=(1, 2)) * are_differences
        variance_mm2 = _by_coordinate(deviation_mm) ** 2 + hysteresis_mm2[:, None]
        self._variance_mm2 = np.eye(variance_mm2.shape[1]) * variance_mm2[..., None]
        self._are_places = seen[..., 0] & ~are_differences[:, None]
        self._score = np.zeros(scaling.count) if start is None else start
        self._damping = _DAMPING_FIRST
        self._steps_left = _ITERATIONS
        self._shaft_rad = scaling.shaft_rad
        self._is_done = False
        self._expected_mm, self._slopes = self._predicted(self._score)
        self._look()

    def improve(self) -> bool:
        """Make a step unless the fit is done; return whether another one may be worthwhile."""
        if self._is_done:
            return False
        self._steps_left -= 1
        goes_on = self._descend() > _DONE and self._steps_left > 0
        is_first = 0.0 < self._shaft_rad == self.scaling.shaft_rad
        if not goes_on and is_first and self._surprise() < 1.0:
            self._shaft_rad *= self._surprise()
            self._damping, self._steps_left = _DAMPING_FIRST, _ITERATIONS
            goes_on = True
        self._is_done = not goes_on
        self._look()
        return goes_on

    def finish(self) -> Fit:
        """Make all remaining steps."""
        while self.improve():
            pass
        return self.result()

    def result(self) -> Fit:
        """The fit so far."""
        residual_mm = self._vectors_mm - self._expected_mm
        stand_out = np.any(_sizes(self._standardised) > _HUBER_DEVIATIONS, axis=1)
        return Fit(
            self._score,
            np.asarray(np.linalg.inv(self._information), dtype=np.float64),
            float(np.sqrt(3.0 * np.mean(residual_mm[self._are_places] ** 2))),
            (self._contrasts != 0.0).T @ stand_out,
            self._surprise(),
            self._cost + self._log_variance,
        )

    def uncertain_mm2(self, q_rad: Array) -> Array:
        """Covariance of the markers, (3 S, 3 S), at motor angles, (n,), by what is not known.

        The model's errors are not in it.
        """
        there = Rests.of_vectors(
            q_rad[None], q_rad[None], np.zeros_like(self._vectors_mm[:1]), np.ones(1)
        )
        _, (slope,) = self._predicted_at(there, self._score)
        covariance: Array = slope @ np.linalg.inv(self._information) @ slope.T
        return covariance

    def _surprise(self) -> float:
        places = _by_marker(self._standardised)[self._are_places]
        return math.sqrt(float(np.mean(places**2)))

    def _look(self) -> None:
        """Find from the slopes at the present scores how well each rest is known.

        An unexplained angle of a shaft moves all markers, as an error of its zero does.
        """
        slope = self._slopes
        by_shaft = slope @ self.scaling.by_shaft(self._shaft_rad)
        covariance_mm2 = self._variance_mm2 + by_shaft @ by_shaft.transpose(0, 2, 1)
        self._whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
        self._log_variance = float(np.linalg.slogdet(covariance_mm2)[1].sum())
        self._standardised, self._cost = self._judge(self._score, self._expected_mm)
        slope = self._whitening @ slope
        weight = np.repeat(_huber_weight(self._standardised), 3, axis=1)[..., None]
        self._information = np.einsum("nip,niq->pq", weight * slope, slope) + np.eye(
            self.scaling.count
        )
        weighted = weight[..., 0] * self._standardised
        self._gradient = np.einsum("nip,ni->p", slope, weighted) - self._score

    def _descend(self) -> float:
        """Damp a step until it leads downhill; return its length, 0 if none does.

        Scores that would leave their bounds stay there, so that the others do not count on them.
        """
        free = ~self.scaling.are_held(self._score, self._gradient)
        gradient = self._gradient[free]
        information = self._information[np.ix_(free, free)]
        while self._damping < _DAMPING_MOST:
            damped = information + self._damping * np.diag(np.diag(information))
            step = np.zeros_like(self._score)
            step[free] = np.linalg.solve(damped, gradient)
            trial = self.scaling.bounded(self._score + step)
            expected_mm, slopes = self._predicted(trial)
            if self._judge(trial, expected_mm)[1] < self._cost:
                length = float(np.abs(trial - self._score).max())
                self._score, self._expected_mm, self._slopes = trial, expected_mm, slopes
                self._damping *= _DAMPING_FALL
                return length
            self._damping *= _DAMPING_RISE
        return 0.0

    def _judge(self, score: Array, expected_mm: Array) -> tuple[Array, float]:
        """Standardised residuals, (N, 3 S), and the cost."""
        residual_mm = _by_coordinate(self._vectors_mm - expected_mm)
        standardised = (self._whitening @ residual_mm[..., None])[..., 0]
        size = _sizes(standardised)
        excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
        return standardised, float((size**2 - excess**2).sum() + (score**2).sum())

    def _contrast(self, rows: Array) -> Array:
        return np.asarray(np.tensordot(self._contrasts, rows, axes=1))

    def _predicted(self, score: Array) -> tuple[Array, Array]:
        expected_mm, slopes = self._predicted_at(self.rests, score)
        return self._contrast(expected_mm), self._contrast(slopes)

    def _predicted_at(self, rests: Rests, score: Array) -> tuple[Array, Array]:
        """The markers, (N, S, 3), and their derivatives by the scores, (N, 3 S, COUNT)."""
        expected_mm, slopes = self._model.predicted_and_slopes(self.scaling, score, rests)
        slopes = slopes.reshape(len(slopes), -1, self.scaling.count)
        slopes[..., self.scaling.roles.pushes] = 0.0
        return expected_mm, slopes


def _contrasts_of(rests: Rests, seen: BoolArray) -> tuple[Array, BoolArray]:
    """What of rests is fitted, (N, N), and which rows of it are differences, (N,).

    The mean of two rests at one pose, reached from either side, depends little on friction and
    backlash; their difference depends on how each hole and gear holds the robot back, of which the
    model knows the kind only. So the mean and half the difference are fitted, and the standard
    deviation of the latter is its own size.
    """
    contrasts, is_difference = np.eye(len(rests.q_rad)), np.zeros(len(rests.q_rad), dtype=bool)
    for first in rests.from_both_sides():
        pair = slice(first, first + 2)
        if np.all(seen[pair] == seen[first]):
            contrasts[pair, pair] = (0.5, 0.5), (0.5, -0.5)
            is_difference[first + 1] = True
    return contrasts, is_difference


def _by_coordinate(markers: Array) -> Array:
    """(N, S, 3) -> (N, 3 S)."""
    return markers.reshape(len(markers), -1)


def _by_marker(coordinates: Array) -> Array:
    """(N, 3 S) -> (N, S, 3)."""
    return coordinates.reshape(len(coordinates), -1, 3)


def _sizes(standardised: Array) -> Array:
    """Length of each marker's standardised residual, (N, S)."""
    return np.asarray(np.linalg.norm(_by_marker(standardised), axis=-1))


def _huber_weight(standardised: Array) -> Array:
    """Huber's weight of each marker, (N, S)."""
    return _HUBER_DEVIATIONS / np.maximum(_sizes(standardised), _HUBER_DEVIATIONS)


class RestSurvey:
    """Collects the measurements of a robot that goes from stop to stop, any robot's.

    ``start_rad``, (n,), are the motor angles before the first tour.
    """

    def __init__(self, start_rad: Array) -> None:
        self._stops_rad = [start_rad]
        self._seen: dict[int, list[Measurement]] = {}
        """What was seen, by the number of the stop."""
        self._since_s = -math.inf

    def visit(self, stops_rad: Array) -> None:
        """Expect the robot at further stops, (N, n), in that order; not all need be rests."""
        self._stops_rad.extend(stops_rad)

    def add(self, history: SetpointHistory, measurement: Measurement) -> None:
        """Keep a measurement if the setpoints had been at rest for long enough."""
        since_s = history.resting_since(measurement.time_s)
        if measurement.time_s - since_s < SETTLED_AFTER_S:
            return
        setpoint_rad = measurement.setpoint_rad
        came_rad = setpoint_rad - history.at(since_s - SETTLED_AFTER_S)
        last = max(self._seen, default=0)
        for number in range(last + (since_s > self._since_s), len(self._stops_rad)):
            stop_rad = self._stops_rad[number]
            travel_rad = stop_rad - self._stops_rad[max(number - 1, 0)]
            if np.array_equal(stop_rad, setpoint_rad) and travel_rad @ came_rad >= 0.0:
                self._since_s = since_s
                self._seen.setdefault(number, []).append(measurement)
                return

    def rests(self) -> Rests:
        """The rests measured so far."""
        stops_rad, numbers = np.array(self._stops_rad), list(self._seen)
        before = np.maximum(np.array(numbers, dtype=int) - 1, 0)
        seen = self._seen.values()
        ends_mm = [median_of_seen(np.array([m.ends_mm for m in each])) for each in seen]
        return Rests.of_vectors(
            stops_rad[before],
            stops_rad[numbers],
            np.array(ends_mm) if ends_mm else np.empty((0, 1, 3)),
            np.array([float(len(each)) for each in seen]),
            np.array([np.mean([m.exposed_s for m in each]) for each in seen]),
        )


class Identification(Generic[P]):
    """The fits to rests under all priors, one step at a time; the likeliest one counts.

    A camera that was never registered may have been aligned. That is believed where the evidence
    for it is strong. It comes from all three axes: about y and z the rests tell the camera's turn
    to a tenth of a degree, about x hardly from a servo's zero. ``scaling`` is the widest prior of
    the parameters.

    A fit that may be one of several is also started elsewhere.
    """

    def __init__(
        self, scaling: ParameterSpace[P], rests: Rests, model: StaticModel[P, Any]
    ) -> None:
        self._model = model
        self._fits = [StaticsFit(prior, rests, model) for prior in scaling.priors()]
        self._further = self._further_fits()

    @property
    def fit(self) -> StaticsFit[P]:
        """The likeliest fit so far."""
        return max(self._fits, key=lambda fit: fit.result().evidence - fit.scaling.doubt)

    def improve(self) -> bool:
        """Make a step unless all fits are done; return whether another one may be worthwhile."""
        if any(fit.improve() for fit in self._fits):
            return True
        further = next(self._further, None)
        if further is None:
            return False
        self._fits.extend(further)
        return True

    def _further_fits(self) -> Iterator[list[StaticsFit[P]]]:
        """Fits that are made once those before are done, and only then can be told."""
        best = self.fit
        if best.scaling.has_modes:
            _, *starts = best.scaling.few_starts()
            yield [StaticsFit(best.scaling, best.rests, self._model, start) for start in starts]
        best = self.fit
        prior = best.scaling.aligned()
        if prior is not None:
            score = best.result().score.copy()
            score[prior.roles.turns] = 0.0
            yield [StaticsFit(prior, best.rests, self._model, score)]

    def finish(self) -> StaticsFit[P]:
        """Make all remaining steps and return the likeliest fit."""
        while self.improve():
            pass
        return self.fit


def identification_of(
    scaling: ParameterSpace[P], rests: Rests, model: StaticModel[P, Any]
) -> Identification[P] | None:
    """Prepare the fits to rests; None if rests are too few, or implausible."""
    if len(rests.q_rad) < _FEWEST_RESTS:
        return None
    prior = scaling.parameters(np.zeros(scaling.count))
    off_mm = np.linalg.norm(rests.tip_mm - model.predicted_mm(prior, rests)[:, -1], axis=1)
    if not np.median(off_mm) < scaling.believable_mm:
        return None
    return Identification(scaling, rests, model)
