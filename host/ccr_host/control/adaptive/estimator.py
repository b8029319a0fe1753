"""What is learnt along the path: by a Kalman filter, and from lap to lap.

The extended Kalman filter estimates the static model's parameters, the servo delay and a tip
offset. The offset is the part that the model does not explain: a slow disturbance with a memory of
a few seconds. Parameters drift slowly, so the model continues to learn during the run. Consistent
innovations free the load on the tip, since payloads and pushes begin suddenly.

``LapMemory`` is iterative learning of that offset along a closed path, with a zero-phase filter,
m_{k+1} = m_k + gain Q (d_k - m_k), where d_k is the offset of tip and model in lap k;
docs/control-statics.md has the condition of convergence.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic

import numpy as np

from ccr_host.control.adaptive.identification import Fit
from ccr_host.control.adaptive.parameter_space import ParameterSpace, Roles
from ccr_host.control.adaptive.static_model import P, S, StaticModel
from ccr_host.control.shell import COMMAND_DELAY_S
from ccr_host.core.arrays import Array

_NOTABLE_HINDRANCE = 0.3
"""Smaller ones, in prior deviations, count as absent, so that noise on the path cannot add them."""


_NOISE_MM = 0.3
"""Standard deviation of a measured coordinate, including unmodelled motion."""
_SWING_MM_PER_RAD = 60.0
"""Increase of this deviation by a jump of the servos."""
_DELAY_DEVIATION_S = 0.015
_OFFSET_DEVIATION_MM = 1.0
"""Least deviation of the offset; it is larger for a robot of which the fit leaves more."""
_OFFSET_MEMORY_S = 10.0
_DRIFT_PER_SQRT_S = 0.02
"""Drift of the parameters, in prior deviations."""
_WARMING_PER_SQRT_S = 0.01
"""Drift of the servos' zeros, in prior deviations: 0.03 deg, for a degree in
twenty minutes (bench/results.md)."""
_GATE_DEVIATIONS = 4.0
"""Larger innovations are reduced to this."""
_INNOVATION_SHARE = 0.2
"""Weight of the newest innovation in their running mean."""
_FREEING = 20.0
"""Squared length of that mean over its expected size at which the load is freed: noise alone
reaches it once in six thousand samples."""
_LOAD_DEVIATION = 0.7
"""Deviation of a freed load, in prior deviations."""
_USUAL_AFTER_S = 3.0
"""Time constant of the usual offset, which is restored when a load is freed."""
_BELIEVED_AFTER_S = 0.3
"""Time constant with which commands follow the estimate. A structure that resonates at 4 to
10 Hz with 2 % damping responds 20 times more strongly there, with a phase that depends on the
latency: the loop gain must be well below 1 at these frequencies."""


class Estimator(Generic[P, S]):
    """Estimates the parameters of the robot, the servo delay and the tip offset.

    Without a ``fit`` it starts from the prior.
    """

    def __init__(
        self,
        model: StaticModel[P, S],
        space: ParameterSpace[P],
        fit: Fit | None,
    ) -> None:
        self._model = model
        self._space = space
        roles = space.roles
        self._score = np.zeros(space.count) if fit is None else fit.score
        """Scores of all parameters before the path, (COUNT,)."""
        uncertain = set(range(space.count)) if fit is None else _unsettled(fit, roles)
        uncertain.difference_update(roles.pushes)
        self._numbers = sorted({*uncertain, *roles.loads, *roles.warming})
        """Those of the scores that are learnt; these come first in the state."""
        count = len(self._numbers)
        self._count, self._states = count, count + 4
        self._offset = slice(count + 1, count + 4)
        self._state = np.zeros(self._states)
        self._state[:count] = self._score[self._numbers]
        self._covariance = np.eye(self._states)
        if fit is not None:
            self._covariance[:count, :count] = fit.covariance[np.ix_(self._numbers, self._numbers)]
        self._offset_mm2 = max(_OFFSET_DEVIATION_MM, 0.0 if fit is None else fit.rms_mm) ** 2
        self._covariance[self._offset, self._offset] = np.eye(3) * self._offset_mm2
        certain = self._rows_of(set(self._numbers) - uncertain)
        self._covariance[certain] = 0.0
        self._covariance[:, certain] = 0.0
        self._loads = self._rows_of(roles.loads)
        drifting = self._rows_of(uncertain.intersection(roles.drifting + roles.hindrances))
        self._drift_per_s = np.zeros(self._states)
        """Growth of the variances."""
        self._drift_per_s[drifting] = _DRIFT_PER_SQRT_S**2
        self._drift_per_s[self._rows_of(roles.warming)] = _WARMING_PER_SQRT_S**2
        self._believed = self._state.copy()
        self._since_believed_s = 0.0
        self._usual_offset_mm = self._state[self._offset].copy()
        self._mean_innovation = np.zeros(3)
        self.parameters: P = space.parameters(self._score_of(self._state))

    @property
    def offset_mm(self) -> Array:
        """Measured minus modelled tip, (3,), low-pass filtered for use in commands."""
        return self._believed[self._offset].copy()

    @property
    def believed(self) -> P:
        """The parameters, low-pass filtered for use in commands."""
        return self._space.parameters(self._score_of(self._believed))

    @property
    def delay_s(self) -> float:
        """Estimated time from a command to the start of its motion."""
        return COMMAND_DELAY_S + _DELAY_DEVIATION_S * float(self._state[self._count])

    def trust(self, jolt_rad: float) -> float:
        """Weight of a measurement relative to one without oscillation."""
        return (_NOISE_MM / self._noise_mm(jolt_rad)) ** 2

    def hand_over(self, offset_mm: Array) -> None:
        """Subtract the part of the offset, (3,), that a memory of earlier laps now accounts for."""
        for state in (self._state, self._believed):
            state[self._offset] -= offset_mm
        self._usual_offset_mm -= offset_mm

    def elapse(self, duration_s: float) -> None:
        """Predict over a time: parameters drift, the offset decays and gains uncertainty."""
        keep = float(np.exp(-duration_s / _OFFSET_MEMORY_S))
        self._state[self._offset] *= keep
        self._covariance[self._offset, :] *= keep
        self._covariance[:, self._offset] *= keep
        growth = self._drift_per_s * duration_s
        growth[self._offset] = self._offset_mm2 * (1.0 - keep * keep)
        self._covariance.flat[:: self._states + 1] += growth
        self._since_believed_s += duration_s

    def correct(
        self,
        pose: S,
        modelled_mm: Array,
        rate_rad_s: Array,
        jolt_rad: float,
        seen_mm: Array,
    ) -> S:
        """Correct the estimate by a measurement.

        Args:
            pose: the model's pose when it was taken.
            modelled_mm: the model's tip there, (3,).
            rate_rad_s: rate of the setpoints at that time, (n,).
            jolt_rad: recent jump of the setpoints.
            seen_mm: measured tip, (3,).

        Returns:
            The pose of the corrected model.
        """
        score, before, numbers = self._score_of(self._state), self.parameters, self._numbers
        by = self._model.sensitivity(self._space, score, numbers, before, pose, rate_rad_s)
        jacobian = np.zeros((3, self._states))
        jacobian[:, : self._count] = by.tip[:, : self._count]
        jacobian[:, self._count] = -_DELAY_DEVIATION_S * by.tip[:, self._count]
        jacobian[:, self._offset] = np.eye(3)
        innovation = seen_mm - (modelled_mm + self._state[self._offset])
        cross = self._covariance @ jacobian.T
        noise_mm = self._noise_mm(jolt_rad)
        innovation_covariance = jacobian @ cross + noise_mm**2 * np.eye(3)
        whitening = np.linalg.inv(np.linalg.cholesky(innovation_covariance))
        normalised = whitening @ innovation
        deviations = float(np.sqrt(normalised @ normalised / 3.0))
        share = min(1.0, _GATE_DEVIATIONS / max(deviations, 1e-9))
        gain = cross @ whitening.T @ whitening
        change = gain @ (share * innovation)
        self._covariance -= gain @ cross.T
        # Rounding makes it asymmetric, which the filter equations would amplify.
        self._covariance = 0.5 * (self._covariance + self._covariance.T)
        self._state += change
        self._hold_at_bounds()
        corrected = self._space.bounded(self._score_of(self._state))
        self._state[: self._count] = corrected[numbers]
        self._state[self._count] = np.clip(self._state[self._count], -2.0, 2.0)
        self.parameters = self._space.parameters(corrected)
        self._free_load_if_innovations_agree(share * normalised)
        self._believe()
        theta = pose.theta_rad + by.theta_rad[:, :-1] @ (corrected - score)[numbers]
        return self._model.shifted(before, self.parameters, pose, theta)

    def _hold_at_bounds(self) -> None:
        """Return scores beyond their bounds to them, and give the others their likeliest values.

        Clipped alone, they would leave the others to count on what they cannot do.
        """
        score = self._score_of(self._state)
        excess = (self._space.bounded(score) - score)[self._numbers]
        beyond = np.flatnonzero(excess)
        if len(beyond):
            covariance = self._covariance[beyond]
            self._state += excess[beyond] @ np.linalg.pinv(covariance[:, beyond]) @ covariance

    def _score_of(self, state: Array) -> Array:
        """Scores of all parameters at a state of the filter, (COUNT,)."""
        score = self._score.copy()
        score[self._numbers] = state[: self._count]
        return score

    def _rows_of(self, numbers: Iterable[int]) -> list[int]:
        """Places of scores in the state."""
        return [self._numbers.index(number) for number in numbers]

    def _noise_mm(self, jolt_rad: float) -> float:
        return _NOISE_MM + _SWING_MM_PER_RAD * jolt_rad

    def _believe(self) -> None:
        share = 1.0 - np.exp(-self._since_believed_s / _BELIEVED_AFTER_S)
        self._believed += share * (self._state - self._believed)
        slowly = 1.0 - np.exp(-self._since_believed_s / _USUAL_AFTER_S)
        self._usual_offset_mm += slowly * (self._state[self._offset] - self._usual_offset_mm)
        self._since_believed_s = 0.0

    def _free_load_if_innovations_agree(self, normalised: Array) -> None:
        share = _INNOVATION_SHARE
        self._mean_innovation = (1.0 - share) * self._mean_innovation + share * normalised
        if self._mean_innovation @ self._mean_innovation * (2.0 - share) / share > _FREEING:
            free = np.maximum(self._covariance[self._loads, self._loads], _LOAD_DEVIATION**2)
            self._covariance[self._loads, self._loads] = free
            self._mean_innovation = np.zeros(3)
            # The part of it that the offset has absorbed is removed, for the load to explain.
            self._state[self._offset] = self._usual_offset_mm


def _unsettled(fit: Fit, roles: Roles) -> set[int]:
    """Parameters that are not certain although they were identified at rest.

    The others cannot be distinguished from disturbances along a path, and what they are wrong by
    changes slowly enough for the offset to follow it. With their uncertainty in the covariance of
    an innovation, the offset of `dirty` took up only a fifth of an error of 5 mm, as they were held
    responsible for it and not corrected. Zeros are certain to begin with, and drift from there.
    """
    notable = {index for index in roles.hindrances if fit.score[index] >= _NOTABLE_HINDRANCE}
    return notable.union(roles.drifting, roles.loads)


_GAIN = 0.5
"""Learning gain: half, so that noise and a single bad lap are averaged out."""
_SMOOTHING_S = 1.0
"""Standard deviation of the filter's Gaussian: nothing is learnt above 0.4 Hz, a tenth of the
lowest resonance; errors of the static model change over some ten seconds of a path."""
_SMOOTHING_STEPS = 0.7
"""Minimum standard deviation: that of (1, 2, 1) / 4, for slow sampling."""
_LARGEST_MM = 2.0
"""Limit of what is learnt from a measurement: more is a payload, a push or confused markers."""


class LapMemory:
    """Tip offset by phase of the path.

    A lap has ``steps`` steps of ``period_s``.
    """

    def __init__(self, steps: int, period_s: float) -> None:
        self._steps = steps
        self._lap = 0
        self._offset_mm = np.zeros((steps, 3))
        self._news_mm = np.zeros((steps, 3))
        self._filter = _low_pass(steps, max(_SMOOTHING_S / period_s, _SMOOTHING_STEPS))

    def at(self, index: float) -> Array:
        """The offset learnt from earlier laps at a fractional step of the whole path, (3,) mm."""
        if self._lap == 0:
            return np.zeros(3)
        before = int(np.floor(index))
        share = index - before
        first = self._offset_mm[before % self._steps]
        second = self._offset_mm[(before + 1) % self._steps]
        return np.asarray((1.0 - share) * first + share * second)

    def note(self, index: float, unexplained_mm: Array, trust: float) -> None:
        """Note measured minus modelled tip, (3,), at a fractional step; trust is from 0 to 1."""
        if index < 0.0:
            return
        step = round(index) % self._steps
        news_mm = unexplained_mm - self._offset_mm[step]
        share = min(1.0, _LARGEST_MM / max(float(np.linalg.norm(news_mm)), 1e-9))
        self._news_mm[step] = trust * share * news_mm

    def turn(self, index: float) -> Array | None:
        """Learn from the last lap when a new one has begun.

        Returns:
            The resulting change of the offset here, (3,) mm; None within a lap.
        """
        if index < (self._lap + 1) * self._steps:
            return None
        before_mm = self.at(index)
        spectrum = np.fft.rfft(self._news_mm, axis=0) * self._filter[:, None]
        news_mm = np.fft.irfft(spectrum, n=self._steps, axis=0)
        self._offset_mm += _GAIN * news_mm
        self._news_mm[:] = 0.0
        self._lap += 1
        return self.at(index) - before_mm


def _low_pass(steps: int, deviation_steps: float) -> Array:
    """Frequency response of a Gaussian on the closed path: real, between 0 and 1."""
    angle = 2.0 * np.pi * np.fft.rfftfreq(steps)
    response: Array = np.exp(-0.5 * (deviation_steps * angle) ** 2)
    return response
