"""Fit the static model to poses seen at rest: regularised, robust least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Robot
from ccr_host.control.adaptive.statics import (
    COUNT,
    Drive,
    Parameters,
    Tip,
    likely_bending_rad,
    parameters_of,
    pose_at,
    prior_of,
    rest_at,
    tip_jacobian_mm_rad,
    tip_mm,
    vector_mm,
)

FloatArray = NDArray[np.float64]

_ITERATIONS = 40
_DAMPING_FIRST, _DAMPING_FALL, _DAMPING_RISE = 1e-3, 0.1, 10.0
_PROBE = 1e-5
_DONE = 1e-3
"""Of a prior deviation: smaller steps of the fit end it."""
_HUBER_DEVIATIONS = 3.0


@dataclass(frozen=True)
class Fit:
    """Parameters in prior deviations from the prior mean.

    ``score`` (COUNT,), ``covariance`` (COUNT, COUNT), ``rms_mm`` of what the fit leaves.
    """

    score: FloatArray
    covariance: FloatArray
    rms_mm: float


class Scaling:
    """Parameters as scores, (parameter - prior mean) / prior deviation, and their bounds."""

    def __init__(self, robot: Robot) -> None:
        prior = prior_of(robot)
        self._mean, self._deviation = prior.mean, prior.deviation
        self._lower = (prior.lower - prior.mean) / prior.deviation
        self._upper = (prior.upper - prior.mean) / prior.deviation

    def parameters(self, score: FloatArray) -> Parameters:
        """Floats for the model."""
        return parameters_of(self._mean + self._deviation * score)

    def perturbed(self, score: FloatArray, probe: float, axes: int) -> Parameters:
        """Each score raised by ``probe`` in turn: arrays (COUNT, 1, ...) with ``axes`` ones."""
        vectors = self._mean + self._deviation * (score + probe * np.eye(COUNT))
        return Parameters(*vectors.T.reshape((COUNT, COUNT) + (1,) * axes))

    def bounded(self, score: FloatArray) -> FloatArray:
        """The nearest scores with a meaning."""
        return np.clip(score, self._lower, self._upper)


def fit_statics(scaling: Scaling, drive: Drive, tip_seen_mm: FloatArray, noise_mm: float) -> Fit:
    """Levenberg and Marquardt's method from the prior.

    Args:
        scaling: prior.
        drive: of each rest, (N, 2) both.
        tip_seen_mm: measured tips, (N, 3).
        noise_mm: standard deviation of a coordinate, model error included.
    """
    score = np.zeros(COUNT)
    theta = likely_bending_rad(scaling.parameters(score), drive.setpoint_rad)
    theta, residual = _residual(scaling, score, drive, tip_seen_mm, theta)
    cost = _cost(residual / noise_mm, score)
    damping = _DAMPING_FIRST
    information = np.eye(COUNT)
    for _ in range(_ITERATIONS):
        slope = tip_sensitivity(scaling, score, theta, drive) / noise_mm
        weighted = slope * _huber_weight(residual / noise_mm)[:, None, None]
        information = np.einsum("nip,nij->pj", weighted, slope) + np.eye(COUNT)
        gradient = np.einsum("nip,ni->p", weighted, residual / noise_mm) - score
        damped = information + damping * np.diag(np.diag(information))
        trial = scaling.bounded(score + np.linalg.solve(damped, gradient))
        trial_theta, trial_residual = _residual(scaling, trial, drive, tip_seen_mm, theta)
        trial_cost = _cost(trial_residual / noise_mm, trial)
        step = float(np.abs(trial - score).max())
        if trial_cost < cost:
            score, theta, residual, cost = trial, trial_theta, trial_residual, trial_cost
            damping *= _DAMPING_FALL
        else:
            damping *= _DAMPING_RISE
        if step < _DONE:
            break
    rms_mm = float(np.sqrt((residual**2).sum(axis=1).mean()))
    return Fit(score, np.asarray(np.linalg.inv(information), dtype=np.float64), rms_mm)


def tip_sensitivity(
    scaling: Scaling, score: FloatArray, theta_rad: FloatArray, drive: Drive
) -> FloatArray:
    """df/dscore at rest, (N, 3, COUNT), by the implicit function theorem.

    At rest g(theta, p) = 0, so df/dp = f_p - f_theta g_theta^-1 g_p.
    """
    here, near = scaling.parameters(score), scaling.perturbed(score, _PROBE, theta_rad.ndim - 1)
    pose, moved = pose_at(here, theta_rad, drive), pose_at(near, theta_rad, drive)
    tip_change = _vector(near, moved.tip) - _vector(here, pose.tip)
    moment_1, moment_2 = moved.moment_1 - pose.moment_1, moved.moment_2 - pose.moment_2
    k_11, k_12, k_22 = pose.stiffness_11, pose.stiffness_12, pose.stiffness_22
    determinant = k_11 * k_22 - k_12 * k_12
    yielding = np.stack(
        [
            (k_12 * moment_2 - k_22 * moment_1) / determinant,
            (k_12 * moment_1 - k_11 * moment_2) / determinant,
        ],
        axis=-1,
    )
    jacobian = tip_jacobian_mm_rad(here, pose.tip)
    change = tip_change + np.einsum("...ij,p...j->p...i", jacobian, yielding)
    return np.asarray(np.moveaxis(change, 0, -1) / _PROBE, dtype=np.float64)


def _vector(p: Parameters, tip: Tip) -> FloatArray:
    return vector_mm(p, tip.across, tip.sagittal)


def _residual(
    scaling: Scaling,
    score: FloatArray,
    drive: Drive,
    tip_seen_mm: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    p = scaling.parameters(score)
    theta = rest_at(p, drive, start)
    return theta, tip_seen_mm - tip_mm(p, theta)


def _cost(standardised: FloatArray, score: FloatArray) -> float:
    size = np.linalg.norm(standardised, axis=1)
    excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
    return float((size**2 - excess**2).sum() + (score**2).sum())


def _huber_weight(standardised: FloatArray) -> FloatArray:
    size = np.linalg.norm(standardised, axis=1)
    weight: FloatArray = _HUBER_DEVIATIONS / np.maximum(size, _HUBER_DEVIATIONS)
    return weight
