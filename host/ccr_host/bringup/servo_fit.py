"""How servos and tendons are mounted, fitted to rests that the tracker has seen.

The neutral angles of the servos are two more unknowns beside those of ``control.adaptive``'s
statics, whose prior knows nothing of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Robot
from ccr_host.control.adaptive.identification import PUSHES, Rests, Scaling, predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Parameters
from ccr_host.errors import CcrError
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.tracking.least_squares import Minimum, minimise

Array = NDArray[np.float64]

_NOISE_MM = 0.2
"""Of a coordinate of a rest: the model's own error, which leaves 0.1 to 0.2 mm RMS of twins, alike
in neighbouring rests."""
_REGISTERED_TURN_RAD = math.radians(0.5)
"""Standard deviation of a registered camera's rotation; the statics' prior has that of others."""
_HUBER_DEVIATIONS = 3.0
_PROBE = 1e-4
"""Of a score, and of a neutral angle in radians."""
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
    scaling = Scaling(robot, _REGISTERED_TURN_RAD if registered else None)
    problem = _Problem(rests, scaling, direction)
    found = min(map(problem.solved_from, _STARTS_RAD), key=Minimum.cost)
    # Residuals larger than believed are errors of the model, of which the deviations must tell.
    misfit = max(1.0, math.sqrt(found.cost() / rests.tip_mm.size))
    deviation_rad = misfit * found.standard_deviations()[COUNT:]
    rms_mm = float(np.sqrt((problem.off_mm(found.unknowns) ** 2).sum(axis=1).mean()))
    if rms_mm > _TRUSTED_RMS_MM or deviation_rad.max() > _TRUSTED_DEVIATION_RAD:
        raise CalibrationError(
            f"the model misses the poses by {rms_mm:.1f} mm RMS, neutral angles are known to "
            f"{np.degrees(deviation_rad.max()):.1f} deg",
            "check geometry, tendons and registration; does a segment touch something?",
        )
    p = scaling.parameters(found.unknowns[:COUNT])
    return ServoFit(
        direction=direction,
        neutral_rad=found.unknowns[COUNT:],
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
    """Unknowns are the scores of the statics' parameters, then both neutral angles."""

    def __init__(self, rests: Rests, scaling: Scaling, direction: Array) -> None:
        self._rests = rests
        self._scaling = scaling
        self._direction = direction

    def solved_from(self, neutral_1_rad: float) -> Minimum:
        """The nearest minimum of the sum of squares."""
        start = np.zeros(COUNT + 2)
        start[COUNT] = neutral_1_rad
        return minimise(
            self.residuals,
            start,
            jacobian=self.jacobian,
            lower=self._scores_bounded(-np.inf),
            upper=self._scores_bounded(np.inf),
            converged=_CONVERGED,
        )

    def residuals(self, unknowns: Array) -> Array:
        """Standardised, so far as they count; the prior's behind those of the tips."""
        off_mm = self.off_mm(unknowns)
        return np.concatenate([_counted(off_mm / _NOISE_MM).ravel(), unknowns[:COUNT]])

    def jacobian(self, unknowns: Array) -> Array:
        """Of the residuals, all columns in one go through the tour."""
        parameters = self._scaling.perturbed(unknowns[:COUNT], _PROBE)
        # Behind a lane for each score and one for none, one for each neutral angle.
        lanes = Parameters(*(np.append(lane, [lane[-1], lane[-1]]) for lane in parameters))
        neutral_rad = unknowns[COUNT:] + _PROBE * np.eye(COUNT + 3, 2, -(COUNT + 1))
        tips_mm = predicted_mm(lanes, self._mounted(neutral_rad))
        off = _counted((self._rests.tip_mm[:, None] - tips_mm) / _NOISE_MM)
        slope = np.delete(off - off[:, COUNT : COUNT + 1], COUNT, axis=1) / _PROBE
        slope[:, PUSHES] = 0.0
        return np.concatenate(
            [np.moveaxis(slope, 1, -1).reshape(-1, COUNT + 2), np.eye(COUNT, COUNT + 2)]
        )

    def off_mm(self, unknowns: Array) -> Array:
        """Of the tips, (N, 3)."""
        parameters = self._scaling.parameters(unknowns[:COUNT])
        return self._rests.tip_mm - predicted_mm(parameters, self._mounted(unknowns[COUNT:]))

    def _scores_bounded(self, extreme: float) -> Array:
        """The bounds nearest to an infinity; neutral angles have none."""
        return np.append(self._scaling.bounded(np.full(COUNT, extreme)), [extreme, extreme])

    def _mounted(self, neutral_rad: Array) -> Rests:
        """The rests in angles of the shafts, for neutral angles (..., 2)."""
        lanes = (1,) * (neutral_rad.ndim - 1)
        commanded_rad = self._rests.setpoint_rad.reshape(-1, *lanes, 2)
        return Rests(
            start_rad=self._direction * (self._rests.start_rad - neutral_rad),
            setpoint_rad=self._direction * (commanded_rad - neutral_rad),
            tip_mm=self._rests.tip_mm,
            count=self._rests.count,
        )


def _counted(standardised: Array) -> Array:
    """Vectors, (..., 3), shortened to where their squares are Huber's loss."""
    size = np.linalg.norm(standardised, axis=-1, keepdims=True)
    excess = np.maximum(size - _HUBER_DEVIATIONS, 0.0)
    return np.asarray(standardised * np.sqrt(1.0 - (excess / np.maximum(size, 1.0)) ** 2))
