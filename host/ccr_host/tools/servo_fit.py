"""How servos and tendons are mounted, fitted to rests that the tracker has seen.

It is the fit of ``control.adaptive``'s statics with a prior that knows next to nothing of the
servos' zeros.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import StaticsFit
from ccr_host.control.adaptive.parameters import COUNT, ZEROS, Scaling
from ccr_host.control.adaptive.statics import zeros_rad
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Rests

Array = NDArray[np.float64]

_REGISTERED_TURN_RAD = math.radians(0.5)
"""Standard deviation of a registered camera's rotation; the statics' prior has that of others. More
than registrations state: servos that are not calibrated yet disturb them."""
_ZERO_DEVIATION_RAD = math.radians(30.0)
_STARTS_RAD = np.radians((-6.0, 6.0))
"""Neutral angles of motor 1 to begin with; friction bends the cost, and one way can end short."""
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
    residual: str
    """What the fit leaves, in words."""


def fit_servos(rests: Rests, description: Description, *, registered: bool) -> ServoFit:
    """Fit and judge.

    Args:
        rests: in the robot's frame; angles as commanded under the present calibration.
        description: what is believed of the robot's geometry and the camera's noise.
        registered: whether the camera's rotation was found out before.

    Raises:
        CalibrationError: too few rests, or the fit cannot be trusted.
    """
    if len(rests.q_rad) < _FEWEST_RESTS:
        raise CalibrationError(
            f"the markers were seen in {len(rests.q_rad)} poses of at least {_FEWEST_RESTS}",
            "see that no marker is hidden: ccr-host monitor",
        )
    direction = _direction(rests, description.robot)
    scaling = Scaling(
        description.robot,
        _REGISTERED_TURN_RAD if registered else None,
        _ZERO_DEVIATION_RAD,
        description.tracker.noise_mm,
    )
    as_mounted = replace(
        rests, start_rad=direction * rests.start_rad, q_rad=direction * rests.q_rad
    )
    starts = np.zeros((len(_STARTS_RAD), COUNT))
    starts[:, ZEROS[0]] = _STARTS_RAD / _ZERO_DEVIATION_RAD
    fits = [StaticsFit(scaling, as_mounted, start=start) for start in starts]
    found = min((fit.finish() for fit in fits), key=lambda fit: fit.cost)
    # Residuals larger than believed are errors of the model, of which the deviations must tell.
    misfit = max(1.0, math.sqrt(found.cost / rests.vectors_mm.size))
    zero_deviations = np.sqrt(np.diag(found.covariance)[ZEROS])
    deviation_rad = misfit * _ZERO_DEVIATION_RAD * zero_deviations
    if not found.explains or deviation_rad.max() > _TRUSTED_DEVIATION_RAD:
        raise CalibrationError(
            f"{found.residual}; neutral angles are known to "
            f"{np.degrees(deviation_rad.max()):.1f} deg",
            "check geometry, tendons and registration; does a segment touch something?",
        )
    p = scaling.parameters(found.score)
    return ServoFit(
        direction=direction,
        neutral_rad=direction * zeros_rad(p),
        neutral_deviation_rad=deviation_rad,
        take_up_rad=np.array([p.slack_1_rad, p.slack_2_rad]),
        gain=np.array([p.gain_1, p.gain_2]),
        residual=found.residual,
    )


def _direction(rests: Rests, robot: Robot) -> Array:
    """1 where the tip moves with the model's along the servo's own axis, -1 where against it."""
    seen_mm = rests.tip_mm
    expected_mm = ConstantCurvature(robot).tip_mm(rests.q_rad)
    together = ((seen_mm - seen_mm.mean(axis=0)) * (expected_mm - expected_mm.mean(axis=0))).sum(
        axis=0
    )
    return np.where(together[[_UP, _SIDEWAYS]] < 0.0, -1.0, 1.0)
