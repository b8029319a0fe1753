"""How servos and tendons are mounted, fitted to rests that the tracker has seen.

It is the fit of ``control.adaptive``'s statics with a prior that knows next to nothing of the
servos' zeros.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Robot
from ccr_host.control.adaptive.identification import PUSHES, ZEROS, Rests, Scaling, predicted_mm
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.control.adaptive.statics import zeros_rad
from ccr_host.errors import CcrError
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.tracking.least_squares import Minimum, minimise

Array = NDArray[np.float64]

_NOISE_MM = 0.2
"""Of a coordinate of a rest: the model's own error, which leaves 0.1 to 0.2 mm RMS of twins, alike
in neighbouring rests."""
_REGISTERED_TURN_RAD = math.radians(0.5)
"""Standard deviation of a registered camera's rotation; the statics' prior has that of others. More
than registrations state: servos that are not calibrated yet disturb them."""
_ZERO_DEVIATION_RAD = math.radians(30.0)
_HUBER_DEVIATIONS = 3.0
_PROBE = 1e-4
"""Of a score."""
_CONVERGED = 1e-4
_STARTS_RAD = np.radians((-6.0, 6.0))
"""Neutral angles of motor 1 to begin with; friction bends the cost, and one way can end short."""
_TRUSTED_RMS_MM = 1.0
_TRUSTED_DEVIATION_RAD = math.radians(1.0)
_FEWEST_RESTS = 12
_SIDEWAYS, _UP = 0, 2
"""Components of f of (10) in which motors 2 and 1 move the tip."""


class CalibrationError(CcrError):
    """The rests give no calibration that could be trusted (exit status 3)."""


@dataclass(frozen=True, eq=False)
class ServoFit:
    """What was found; all arrays (2,), one entry a servo."""

    direction: Array
    """1 as described, -1 the other way round."""
    neutral_rad: Array
    """Angle, as described so far, at which the shaft stands at 0."""
    neutral_deviation_rad: Array
    """Standard deviation of it."""
    take_up_rad: Array
    """Motor angle that takes up the slack of a straight segment."""
    gain: Array
    """Bending over motor angle of taut tendons; the description says r_p / r_c."""
    rms_mm: float
    """Of the tips that the fit leaves."""


def fit_servos(rests: Rests, robot: Robot, *, registered: bool) -> ServoFit:
    """Fit and judge.

    Args:
        rests: in the robot's frame; angles as commanded under the present calibration.
        robot: what is believed of its geometry.
        registered: whether the camera's rotation was found out before.

    Raises:
        CalibrationError: too few rests, or the fit cannot be trusted.
    """
    if len(rests.setpoint_rad) < _FEWEST_RESTS:
        raise CalibrationError(
            f"the markers were seen in {len(rests.setpoint_rad)} poses of at least {_FEWEST_RESTS}",
            "see that no marker is hidden: ccr-host monitor",
        )
    direction = _direction(rests, robot)
    scaling = Scaling(robot, _REGISTERED_TURN_RAD if registered else None, _ZERO_DEVIATION_RAD)
    problem = _Problem(
        replace(
            rests,
            start_rad=direction * rests.start_rad,
            setpoint_rad=direction * rests.setpoint_rad,
        ),
        scaling,
    )
    found = min(map(problem.solved_from, _STARTS_RAD), key=Minimum.cost)
    # Residuals larger than believed are errors of the model, of which the deviations must tell.
    misfit = max(1.0, math.sqrt(found.cost() / rests.tip_mm.size))
    deviation_rad = misfit * _ZERO_DEVIATION_RAD * found.standard_deviations()[ZEROS]
    rms_mm = float(np.sqrt((problem.off_mm(found.unknowns) ** 2).sum(axis=1).mean()))
    if rms_mm > _TRUSTED_RMS_MM or deviation_rad.max() > _TRUSTED_DEVIATION_RAD:
        raise CalibrationError(
            f"the model misses the poses by {rms_mm:.1f} mm RMS, neutral angles are known to "
            f"{np.degrees(deviation_rad.max()):.1f} deg",
            "check geometry, tendons and registration; does a segment touch something?",
        )
    p = scaling.parameters(found.unknowns)
    return ServoFit(
        direction=direction,
        neutral_rad=direction * zeros_rad(p),
        neutral_deviation_rad=deviation_rad,
        take_up_rad=np.array([p.slack_1_rad, p.slack_2_rad]),
        gain=np.array([p.gain_1, p.gain_2]),
        rms_mm=rms_mm,
    )


def _direction(rests: Rests, robot: Robot) -> Array:
    """1 where the tip moves with the model's along the servo's own axis, -1 where against it."""
    seen_mm = rests.tip_mm
    expected_mm = ConstantCurvature(robot).tip_mm(rests.setpoint_rad)
    together = ((seen_mm - seen_mm.mean(axis=0)) * (expected_mm - expected_mm.mean(axis=0))).sum(
        axis=0
    )
    return np.where(together[[_UP, _SIDEWAYS]] < 0.0, -1.0, 1.0)


class _Problem:
    """Unknowns are the scores of the statics' parameters."""

    def __init__(self, rests: Rests, scaling: Scaling) -> None:
        self._rests = rests
        self._scaling = scaling

    def solved_from(self, zero_1_rad: float) -> Minimum:
        """The nearest minimum of the sum of squares."""
        start = np.zeros(COUNT)
        start[ZEROS[0]] = zero_1_rad / _ZERO_DEVIATION_RAD
        return minimise(
            self.residuals,
            start,
            jacobian=self.jacobian,
            lower=self._scaling.bounded(np.full(COUNT, -np.inf)),
            upper=self._scaling.bounded(np.full(COUNT, np.inf)),
            converged=_CONVERGED,
        )

    def residuals(self, score: Array) -> Array:
        """Standardised, so far as they count; the prior's behind those of the tips."""
        return np.concatenate([_counted(self.off_mm(score) / _NOISE_MM).ravel(), score])

    def jacobian(self, score: Array) -> Array:
        """Of the residuals, all columns in one go through the tour."""
        tips_mm = predicted_mm(self._scaling.perturbed(score, _PROBE), self._rests)
        off = _counted((self._rests.tip_mm[:, None] - tips_mm) / _NOISE_MM)
        slope = (off[:, :COUNT] - off[:, COUNT:]) / _PROBE
        slope[:, PUSHES] = 0.0
        return np.concatenate([np.moveaxis(slope, 1, -1).reshape(-1, COUNT), np.eye(COUNT)])

    def off_mm(self, score: Array) -> Array:
        """Of the tips, (N, 3)."""
        return self._rests.tip_mm - predicted_mm(self._scaling.parameters(score), self._rests)


def _counted(standardised: Array) -> Array:
    """Vectors, (..., 3), shortened to where their squares are Huber's loss."""
    size = np.linalg.norm(standardised, axis=-1, keepdims=True)
    excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
    return np.asarray(standardised * np.sqrt(1.0 - (excess / np.maximum(size, 1.0)) ** 2))
