"""Identification: the tour of rests, and the fit of the static model to it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccr_host.control.adaptive.arithmetic import FloatArray, stacked
from ccr_host.control.adaptive.motion import first_pose, moved
from ccr_host.control.adaptive.parameters import COUNT, PUSHES, Parameters, Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.control.adaptive.tip import markers_of
from ccr_host.control.shell import Measurement
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

_ITERATIONS = 20
_DAMPING_FIRST, _DAMPING_FALL, _DAMPING_RISE, _DAMPING_MOST = 1e-3, 0.1, 10.0, 1e3
_PROBE = 1e-4
_DONE = 1e-2
"""The fit ends when its steps are shorter than this fraction of a prior deviation."""
_HUBER_DEVIATIONS = 3.0
_SURPRISING = 2.5
"""Ratio of residual to expected residual above which the model does not explain the robot; at most
0.85 in the tours of 40 random robots (`bench.misfits.matching`)."""

_ROWS_RAD = np.radians((0.0, 50.0, 100.0, -100.0, -50.0))
_COLUMNS_RAD = np.radians((-110.0, -40.0, 40.0, 110.0))
SETTLED_AFTER_S = 0.15
"""Time after which a tip counts as resting when its servos rest."""
_FEWEST_RESTS = 10
_BELIEVABLE_MM = 60.0
"""Random robots are 10 to 30 mm off the prior; confused markers are further off."""
_PULSE_KEYS = {"neutral_pulse_us", "pulse_per_90_deg_us"}
"""The servo keys that define a commanded angle; limits may change."""
_DIGITS = 12


def predicted_mm(p: Parameters, rests: Rests) -> FloatArray:
    """M2 and M3 at the rests, (N, ..., 2, 3), for parameters that are floats or arrays (...)."""
    pose = first_pose(p, *rests.start_rad.tolist())
    markers = []
    for q_1, q_2 in rests.q_rad.tolist():
        pose = moved(p, pose, q_1, q_2)
        middle, tip = markers_of(p, pose.theta_1, pose.theta_2)
        markers.append(np.stack([stacked(*middle), stacked(*tip)], axis=-2))
    return np.array(markers)


@dataclass(frozen=True)
class Fit:
    """Parameters in prior deviations from the prior mean.

    ``score`` (COUNT,), ``covariance`` (COUNT, COUNT), ``rms_mm`` of the markers'
    residuals, and its expectation from noise and the model's usual error; ``cost`` is the minimised
    sum of squared standardised residuals (robust) and squared scores.
    """

    score: FloatArray
    covariance: FloatArray
    rms_mm: float
    expected_rms_mm: float
    cost: float

    @property
    def explains(self) -> bool:
        """Whether the model explains the rests: residuals are noise and its usual error."""
        return self.rms_mm < _SURPRISING * self.expected_rms_mm

    @property
    def residual(self) -> str:
        """The residual of the fit, in words."""
        verdict = "" if self.explains else ": it does not explain the robot"
        return (
            f"the model leaves {self.rms_mm:.2f} mm RMS, where the camera's noise and its usual "
            f"error make {self.expected_rms_mm:.2f}{verdict}"
        )


Predict = Callable[[Parameters, Rests], FloatArray]


class StaticsFit:
    """Fit by Levenberg and Marquardt's method, one step at a time.

    A step takes tenths of a second; between steps the host must send commands to the board.

    Args:
        scaling: prior of the parameters.
        rests: the measurements.
        predict: replaces ``predicted_mm``.
        start: initial scores, (COUNT,); by default those of the prior.
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
        self._seen = np.isfinite(rests.vectors_mm).all(axis=-1).ravel()
        self._weight = 1.0 / np.repeat(scaling.deviation_mm(rests.count), 2)[self._seen, None]
        self._score = np.zeros(COUNT) if start is None else start
        self._residual_mm, self._cost = self._judge(self._score)
        self._information = np.eye(COUNT)
        self._damping = _DAMPING_FIRST
        self._steps_left = _ITERATIONS

    def improve(self) -> bool:
        """Make a step; return whether another one may be worthwhile."""
        scaled = self._residual_mm * self._weight
        slope = self._sensitivity() * self._weight[..., None]
        weighted = slope * _huber_weight(scaled)[:, None, None]
        self._information = np.einsum("nip,niq->pq", weighted, slope) + np.eye(COUNT)
        gradient = np.einsum("nip,ni->p", weighted, scaled) - self._score
        self._steps_left -= 1
        return self._descend(gradient) > _DONE and self._steps_left > 0

    def finish(self) -> Fit:
        """Make all remaining steps."""
        while self.improve():
            pass
        return self.result()

    def result(self) -> Fit:
        """The fit so far."""
        rms_mm = float(np.sqrt((self._residual_mm**2).sum(axis=1).mean()))
        expected_mm = math.sqrt(3.0 * float((self._weight**-2.0).mean()))
        covariance = np.asarray(np.linalg.inv(self._information), dtype=np.float64)
        return Fit(self._score, covariance, rms_mm, expected_mm, self._cost)

    def _descend(self, gradient: FloatArray) -> float:
        """Damp a step until it leads downhill; return its length, 0 if none does."""
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
        residual_mm = (self.rests.vectors_mm - predicted).reshape(-1, 3)[self._seen]
        return residual_mm, _cost(residual_mm * self._weight, score)

    def _sensitivity(self) -> FloatArray:
        """d marker / d score of each marker seen, (M, 3, COUNT), including the path to the pose."""
        near_mm = self._predict(self.scaling.perturbed(self._score, _PROBE), self.rests)
        slope = np.moveaxis(near_mm[:, :COUNT] - near_mm[:, COUNT:], 1, -1) / _PROBE
        slope[..., PUSHES] = 0.0
        return slope.reshape(-1, 3, COUNT)[self._seen]


def _cost(standardised: FloatArray, score: FloatArray) -> float:
    size = np.linalg.norm(standardised, axis=1)
    excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
    return float((size**2 - excess**2).sum() + (score**2).sum())


def _huber_weight(standardised: FloatArray) -> FloatArray:
    size = np.linalg.norm(standardised, axis=1)
    weight: FloatArray = _HUBER_DEVIATIONS / np.maximum(size, _HUBER_DEVIATIONS)
    return weight


def tour_bending_rad() -> FloatArray:
    """Bending angles at which all parameters are observable, (N, 2), in an order of short moves.

    They cover the workspace: only large bends distinguish the camera's rotation from the robot's
    sag.
    """
    stops: list[tuple[float, float]] = []
    for number, row in enumerate(_ROWS_RAD):
        columns = _COLUMNS_RAD if number % 2 == 0 else _COLUMNS_RAD[::-1]
        stops.extend((row, column) for column in columns)
    return np.array(stops)


def tour_stops_rad(p: Parameters, limits: MotorLimits) -> FloatArray:
    """Motor angles of the tour's rests, (N, 2), as far as the limits allow.

    Args:
        p: believed parameters of the robot, floats.
        limits: limits of the motors.
    """
    return limits.clip(unhindered_setpoints_for(p, tour_bending_rad()))


class RestSurvey:
    """Collects measurements and prepares the fit of the model to them.

    Args:
        scaling: prior of the parameters.
        predict: replaces ``predicted_mm`` in the fit.
    """

    def __init__(self, scaling: Scaling, predict: Predict | None = None) -> None:
        self.start_rad = np.zeros(2)
        """Motor angles before the tour, (2,)."""
        self._predict = predict
        self._scaling = scaling
        self._setpoints_rad: list[FloatArray] = []
        self._markers_mm: list[list[FloatArray]] = []

    def add(self, history: SetpointHistory, measurement: Measurement) -> None:
        """Keep a measurement if the setpoints had been at rest for long enough."""
        if measurement.time_s - history.resting_since(measurement.time_s) < SETTLED_AFTER_S:
            return
        setpoint = measurement.setpoint_rad
        if not self._setpoints_rad or not np.array_equal(setpoint, self._setpoints_rad[-1]):
            self._setpoints_rad.append(setpoint)
            self._markers_mm.append([])
        self._markers_mm[-1].append(np.stack([measurement.middle_mm, measurement.tip_mm]))

    def rests(self) -> Rests:
        """The rests measured so far."""
        return Rests.of_vectors(
            self.start_rad,
            np.array(self._setpoints_rad),
            np.array([np.mean(seen, axis=0) for seen in self._markers_mm]),
            np.array([float(len(seen)) for seen in self._markers_mm]),
        )

    def fit(self) -> StaticsFit | None:
        """Prepare the fit to the measured rests; None if they are not suitable."""
        return fit_to(self._scaling, self.rests(), self._predict)


def fit_to(scaling: Scaling, rests: Rests, predict: Predict | None = None) -> StaticsFit | None:
    """Prepare the fit to rests; None if there are too few, or they are implausible."""
    if len(rests.q_rad) < _FEWEST_RESTS:
        return None
    prior = scaling.parameters(np.zeros(COUNT))
    off_mm = np.linalg.norm(rests.tip_mm - predicted_mm(prior, rests)[:, 1], axis=1)
    if not np.median(off_mm) < _BELIEVABLE_MM:
        return None
    return StaticsFit(scaling, rests, predict)


def digest_of(description: Description) -> str:
    """Digest of everything in a description that its identified rests depend on."""
    registration = description.registration
    robot = description.robot.model_dump(exclude={"segments"})
    if description.robot.gravity_direction == Robot().gravity_direction:
        # Files identified before the key existed stay valid.
        del robot["gravity_direction"]
    meaning = {
        "robot": robot,
        "servo": description.servo.model_dump(include=_PULSE_KEYS),
        "camera": None if registration is None else registration.camera_to_robot_deg,
    }
    text = json.dumps(meaning, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def identified_rests(description: Description) -> Rests | None:
    """The rests stored in a description; None if there are none.

    Raises:
        ConfigError: they were measured with another geometry, servo pulses or registration.
    """
    identified = description.identified
    if identified is None:
        return None
    if identified.valid_for != digest_of(description):
        raise ConfigError(
            "section identified was measured with another [robot], other servo pulses or another "
            "[registration]",
            "identify again: ccr-host calibrate --identify; or remove the section",
        )
    not_seen = np.full_like(identified.tip_mm, np.nan)
    middle_mm = np.array(identified.middle_mm) if identified.middle_mm else not_seen
    return Rests.of_vectors(
        np.array(identified.start_rad),
        np.array(identified.setpoint_rad),
        np.stack([middle_mm, identified.tip_mm], axis=1),
        np.array(identified.count, dtype=np.float64),
    )
