"""Fits the mounting of servos and tendons to rests measured by the tracker.

This is the fit of ``control.adaptive``'s statics with a wide prior for the servos' zeros.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import StaticsFit
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.parameters import COUNT, ZEROS, Scaling
from ccr_host.control.adaptive.statics import zeros_rad
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Rests

Array = NDArray[np.float64]

_REGISTERED_TURN_RAD = math.radians(0.5)
"""Standard deviation of a registered camera's rotation; for others that of the statics' prior is
used. Larger than registrations state, as servos that are not yet calibrated disturb them."""
_ZERO_DEVIATION_RAD = math.radians(30.0)
_STARTS_RAD = np.radians((-6.0, 6.0))
"""Starting values of the neutral angle of motor 1; friction distorts the cost, so that one start
alone can end in a local minimum."""
_TRUSTED_DEVIATION_RAD = math.radians(1.0)
_FEWEST_RESTS = 12
_SIDEWAYS, _UP = 0, 2
"""Components of f of (10) in which motors 2 and 1 move the tip."""


class CalibrationError(CcrError):
    """The rests do not determine the calibration reliably (exit status 3)."""


@dataclass(frozen=True, eq=False)
class ServoFit:
    """Result of the fit; all arrays are (2,), one entry per servo."""

    direction: Array
    """1 if as described, -1 if reversed."""
    neutral_rad: Array
    """Angle under the present calibration at which the shaft is at 0."""
    neutral_deviation_rad: Array
    """Standard deviation of ``neutral_rad``."""
    take_up_rad: Array
    """Motor angle that takes up the slack of a straight segment."""
    gain: Array
    """Bending over motor angle with taut tendons; r_p / r_c in the description."""
    residual: str
    """Residual of the fit, in words."""


def fit_servos(rests: Rests, description: Description, *, registered: bool) -> ServoFit:
    """Fit the mounting and check the result.

    Args:
        rests: rests in the robot frame, with the angles commanded under the present calibration.
        description: geometry of the robot and noise of the camera.
        registered: whether the camera's rotation was measured before.

    Raises:
        CalibrationError: too few rests, or the fit is not reliable.
    """
    if len(rests.q_rad) < _FEWEST_RESTS:
        raise CalibrationError(
            f"the markers were seen in {len(rests.q_rad)} poses; {_FEWEST_RESTS} are needed",
            "check with ccr-host monitor that no marker is hidden",
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
    predict = make_model(description.control).predicted_mm
    fits = [StaticsFit(scaling, as_mounted, predict, start) for start in starts]
    found = min((fit.finish() for fit in fits), key=lambda fit: fit.cost)
    # Residuals above the noise are model errors, by which the deviations are enlarged.
    misfit = max(1.0, found.surprise)
    zero_deviations = np.sqrt(np.diag(found.covariance)[ZEROS])
    deviation_rad = misfit * _ZERO_DEVIATION_RAD * zero_deviations
    if not found.explains or deviation_rad.max() > _TRUSTED_DEVIATION_RAD:
        raise CalibrationError(
            f"{found.residual}; neutral angles are uncertain by "
            f"{np.degrees(deviation_rad.max()):.1f} deg",
            "check geometry, tendons and registration, and that no segment touches anything",
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
    """1 if the tip moves like the model's along the servo's axis, -1 if the other way, (2,)."""
    seen_mm = rests.tip_mm
    expected_mm = ConstantCurvature(robot).tip_mm(rests.q_rad)
    together = ((seen_mm - seen_mm.mean(axis=0)) * (expected_mm - expected_mm.mean(axis=0))).sum(
        axis=0
    )
    return np.where(together[[_UP, _SIDEWAYS]] < 0.0, -1.0, 1.0)
