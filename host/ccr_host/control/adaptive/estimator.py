"""Extended Kalman filter over the static model's parameters, the servo delay and a tip offset.

The offset is what the model does not explain: a slow disturbance with a memory of a few seconds.
Parameters drift slowly, so the model keeps learning during the run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import Fit, Scaling, tip_sensitivity
from ccr_host.control.adaptive.statics import (
    COUNT,
    Drive,
    Parameters,
    likely_bending_rad,
    rest_at,
    tip_mm,
)

FloatArray = NDArray[np.float64]

_DELAY = COUNT
_OFFSET = slice(COUNT + 1, COUNT + 4)
_STATES = COUNT + 4
_DRIFTING = [
    Parameters._fields.index(name)
    for name in (
        "compliance_1",
        "compliance_2",
        "slack_1_rad",
        "slack_2_rad",
        "tip_per_mm",
    )
]
"""Geometry stays what it is; threads creep and tools change."""
_HINDRANCES = [Parameters._fields.index(name) for name in ("play_rad", "friction_1", "friction_2")]
_NOTABLE_HINDRANCE = 0.3
"""In prior deviations. Where identification found less, noise must not find any along the path."""
_IDENTIFIED = [index for index in range(COUNT) if index not in _DRIFTING + _HINDRANCES]
"""Once identified at rest these are only considered, not corrected: along a path they could not be
told from disturbances."""


@dataclass(frozen=True)
class Tuning:
    """What the filter assumes."""

    noise_mm: float = 0.3
    """Of a measured coordinate, unmodelled motion included."""
    delay_s: float = 0.038
    """From a command to the start of its motion: half a tick, a tick of pulses, transport."""
    delay_deviation_s: float = 0.015
    offset_deviation_mm: float = 1.0
    offset_memory_s: float = 10.0
    drift_per_sqrt_s: float = 0.02
    """Of the parameters, in prior deviations."""
    gate_deviations: float = 4.0
    """Larger surprises are taken down to this."""


class Estimator:
    """Keeps what is known of the robot.

    Args:
        scaling: prior of the parameters.
        fit: what identification has found, None to start from the prior.
        tuning: of the filter.
    """

    def __init__(self, scaling: Scaling, fit: Fit | None, tuning: Tuning) -> None:
        self._scaling = scaling
        self._tuning = tuning
        self._state = np.zeros(_STATES)
        self._covariance = np.eye(_STATES)
        if fit is not None:
            self._state[:COUNT] = fit.score
            self._covariance[:COUNT, :COUNT] = fit.covariance
        self._covariance[_OFFSET, _OFFSET] = np.eye(3) * tuning.offset_deviation_mm**2
        self._considered = [] if fit is None else _settled(fit)
        self._theta: FloatArray | None = None
        self.parameters: Parameters = scaling.parameters(self._state[:COUNT])

    @property
    def offset_mm(self) -> FloatArray:
        """Tip seen minus tip modelled, (3,)."""
        return self._state[_OFFSET].copy()

    @property
    def delay_s(self) -> float:
        """From a command to the start of its motion."""
        tuning = self._tuning
        return tuning.delay_s + tuning.delay_deviation_s * float(self._state[_DELAY])

    def elapse(self, duration_s: float) -> None:
        """Let time pass: parameters drift, the offset fades and is renewed."""
        tuning = self._tuning
        keep = float(np.exp(-duration_s / tuning.offset_memory_s))
        self._state[_OFFSET] *= keep
        self._covariance[_OFFSET, :] *= keep
        self._covariance[:, _OFFSET] *= keep
        renewed = tuning.offset_deviation_mm**2 * (1.0 - keep * keep)
        diagonal = np.zeros(_STATES)
        variance = tuning.drift_per_sqrt_s**2 * duration_s
        diagonal[_DRIFTING + _HINDRANCES] = variance
        diagonal[_OFFSET] = renewed
        self._covariance[np.diag_indices(_STATES)] += diagonal

    def correct(self, drive: Drive, rate_rad_s: FloatArray, seen_mm: FloatArray) -> FloatArray:
        """Take in one measurement.

        Args:
            drive: of the servos when it was taken, (2,) both.
            rate_rad_s: their rate then, (2,).
            seen_mm: measured tip, (3,).

        Returns:
            Measured minus expected tip before the correction, (3,).
        """
        tuning = self._tuning
        p = self.parameters
        start = likely_bending_rad(p, drive.setpoint_rad) if self._theta is None else self._theta
        theta = rest_at(p, drive, start)
        self._theta = theta
        slope = np.zeros((3, _STATES))
        slope[:, :COUNT] = tip_sensitivity(self._scaling, self._state[:COUNT], theta, drive)
        further = drive.setpoint_rad + 1e-3 * _direction(rate_rad_s)
        ahead = tip_mm(p, rest_at(p, drive._replace(setpoint_rad=further), theta))
        here = tip_mm(p, theta)
        speed = (ahead - here) / 1e-3 * float(np.linalg.norm(rate_rad_s))
        slope[:, _DELAY] = -speed * tuning.delay_deviation_s
        slope[:, _OFFSET] = np.eye(3)
        surprise = seen_mm - here - self._state[_OFFSET]
        cross = self._covariance @ slope.T
        spread = slope @ cross + tuning.noise_mm**2 * np.eye(3)
        size = float(np.sqrt(surprise @ np.linalg.solve(spread, surprise) / 3.0))
        share = min(1.0, tuning.gate_deviations / max(size, 1e-9))
        gain = np.linalg.solve(spread, cross.T).T
        gain[self._considered] = 0.0
        self._state += gain @ (share * surprise)
        correction = gain @ cross.T
        self._covariance += gain @ spread @ gain.T - correction - correction.T
        # Rounding makes it lopsided, and that grows: no filter equation pulls it back.
        self._covariance = 0.5 * (self._covariance + self._covariance.T)
        self._state[:COUNT] = self._scaling.bounded(self._state[:COUNT])
        self._state[_DELAY] = np.clip(self._state[_DELAY], -2.0, 2.0)
        self.parameters = self._scaling.parameters(self._state[:COUNT])
        return np.asarray(surprise)


def _settled(fit: Fit) -> list[int]:
    absent = [index for index in _HINDRANCES if fit.score[index] < _NOTABLE_HINDRANCE]
    return _IDENTIFIED + absent


def _direction(rate: FloatArray) -> FloatArray:
    size = float(np.linalg.norm(rate))
    return rate / size if size > 0.0 else rate
