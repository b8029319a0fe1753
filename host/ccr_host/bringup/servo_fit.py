"""How servos and tendons are mounted, fitted to rest poses that the tracker has seen.

For given directions and neutral angles of the servos the statics of ``control.adaptive`` are fitted
to the tips; the neutral angles are then moved by Gauss and Newton's method on what that leaves
(variable projection).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Robot
from ccr_host.control.adaptive.identification import (
    Fit,
    Rests,
    Scaling,
    fit_statics,
    predicted_mm,
)
from ccr_host.errors import CcrError
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.tracking.registration import RestPose

Array = NDArray[np.float64]

_NOISE_MM = 0.1
"""Of a coordinate of a pose, an average over 1.5 s: the model's own error, mostly."""
_TURN_DEVIATION_RAD = math.radians(0.5)
"""What registration is good for."""
_SCAN_RAD = np.radians((-8.0, -4.0, 0.0, 4.0, 8.0))
"""Neutral angles to begin with, half a tooth of a servo's horn: from afar Gauss and Newton's method
can end where the model mistakes an offset for a gain."""
_PROBE_RAD = math.radians(0.5)
_LONGEST_STEP_RAD = math.radians(4.0)
_DONE_RAD = math.radians(0.02)
_ITERATIONS = 10
_SHORTEST_SHARE = 0.1
_TRUSTED_RMS_MM = 1.0
"""Twins with friction, deadband and 0.5 mm of noise leave 0.13 mm."""
_TRUSTED_DEVIATION_RAD = math.radians(1.0)
_FEWEST_POSES = 12
_SIDEWAYS, _UP = 0, 2
"""Components of f of (10) in which motors 2 and 1 move the tip."""


class CalibrationError(CcrError):
    """The poses give no calibration that could be trusted (exit status 3)."""


@dataclass(frozen=True, eq=False)
class ServoFit:
    """What was found; all arrays (2,), one entry a servo."""

    direction: Array
    """1 as described, -1 the other way round."""
    neutral_rad: Array
    """Angle, as described so far, at which the shaft stands at 0."""
    neutral_deviation_rad: Array
    take_up_rad: Array
    """Motor angle that takes up the slack of a straight segment."""
    gain: Array
    """Bending over motor angle of taut tendons; the description says r_p / r_c."""
    rms_mm: float
    """Of the tips that the fit leaves."""


def fit_servos(poses: Sequence[RestPose], robot: Robot) -> ServoFit:
    """Fit and judge.

    Args:
        poses: in the order in which the robot came to them from 0, in the robot's frame; angles as
            commanded under the present calibration.
        robot: what is believed of its geometry.

    Raises:
        CalibrationError: too few poses, or none of the fits could be trusted.
    """
    if len(poses) < _FEWEST_POSES:
        raise CalibrationError(
            f"the markers were seen in {len(poses)} poses of at least {_FEWEST_POSES}",
            "see that no marker is hidden: ccr-host monitor",
        )
    problem = _Problem(poses, robot)
    direction = _direction(poses, robot)
    neutral_rad, deviation_rad, fit = _neutral(problem, direction)
    p = problem.scaling.parameters(fit.score)
    if fit.rms_mm > _TRUSTED_RMS_MM or deviation_rad.max() > _TRUSTED_DEVIATION_RAD:
        raise CalibrationError(
            f"the model misses the poses by {fit.rms_mm:.1f} mm RMS, neutral angles are known to "
            f"{np.degrees(deviation_rad.max()):.1f} deg",
            "check geometry, tendons and registration; does a segment touch something?",
        )
    return ServoFit(
        direction=direction,
        neutral_rad=neutral_rad,
        neutral_deviation_rad=deviation_rad,
        take_up_rad=np.array([p.slack_1_rad, p.slack_2_rad]),
        gain=np.array([p.gain_1, p.gain_2]),
        rms_mm=fit.rms_mm,
    )


class _Problem:
    def __init__(self, poses: Sequence[RestPose], robot: Robot) -> None:
        self.scaling = Scaling(robot, _TURN_DEVIATION_RAD)
        self._q_rad = np.array([pose.q_rad for pose in poses])
        self._tip_mm = np.array([pose.markers_mm[2] - pose.markers_mm[0] for pose in poses])

    def fit(
        self, direction: Array, neutral_rad: Array, near: Fit | None = None
    ) -> tuple[Fit, Array]:
        """Statics under given mounting, and the standardised residual, prior included."""
        rests = Rests(
            start_rad=direction * -neutral_rad,
            setpoint_rad=direction * (self._q_rad - neutral_rad),
            tip_mm=self._tip_mm,
            count=np.ones(len(self._q_rad)),
        )
        fit = fit_statics(self.scaling, rests, _NOISE_MM, None if near is None else near.score)
        off_mm = self._tip_mm - predicted_mm(self.scaling.parameters(fit.score), rests)
        return fit, np.concatenate([off_mm.ravel() / _NOISE_MM, fit.score])

    def cost(self, direction: Array, neutral_rad: Array) -> float:
        """Squares of what a fit leaves."""
        residual = self.fit(direction, neutral_rad)[1]
        return float(residual @ residual)


def _direction(poses: Sequence[RestPose], robot: Robot) -> Array:
    """1 where the tip moves with the model's along the servo's own axis, -1 where against it."""
    q_rad = np.array([pose.q_rad for pose in poses])
    seen_mm = np.array([pose.markers_mm[2] - pose.markers_mm[0] for pose in poses])
    expected_mm = ConstantCurvature(robot).tip_mm(q_rad)
    together = ((seen_mm - seen_mm.mean(axis=0)) * (expected_mm - expected_mm.mean(axis=0))).sum(
        axis=0
    )
    return np.where(together[[_UP, _SIDEWAYS]] < 0.0, -1.0, 1.0)


def _neutral(problem: _Problem, direction: Array) -> tuple[Array, Array, Fit]:
    """Neutral angles and their standard deviations, (2,) each, rad; the statics with them."""
    neutral = np.zeros(2)
    for axis in (1, 0):
        candidates = [neutral + (angle - neutral[axis]) * np.eye(2)[axis] for angle in _SCAN_RAD]
        neutral = min(candidates, key=lambda angles: problem.cost(direction, angles))
    fit, residual = problem.fit(direction, neutral)
    for _ in range(_ITERATIONS):
        slope = np.stack(
            [
                (problem.fit(direction, neutral + probe, fit)[1] - residual) / _PROBE_RAD
                for probe in _PROBE_RAD * np.eye(2)
            ],
            axis=1,
        )
        step = -np.linalg.lstsq(slope, residual, rcond=None)[0]
        step = np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD)
        share, trial = 1.0, problem.fit(direction, neutral + step, fit)
        while _cost(trial) > residual @ residual and share > _SHORTEST_SHARE:
            share /= 2.0
            trial = problem.fit(direction, neutral + share * step, fit)
        if _cost(trial) > residual @ residual:
            break
        neutral = neutral + share * step
        fit, residual = trial
        if np.abs(share * step).max() < _DONE_RAD:
            break
    covariance = np.linalg.inv(slope.T @ slope)
    return neutral, np.sqrt(np.diag(covariance)), fit


def _cost(trial: tuple[Fit, Array]) -> float:
    return float(trial[1] @ trial[1])
