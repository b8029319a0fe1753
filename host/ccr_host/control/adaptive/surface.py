"""What the robot of a description's identified rests reaches."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.control.adaptive.identification import identification_of
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.motion import first_pose
from ccr_host.control.adaptive.parameters import Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.control.adaptive.tip import straight_tip_mm
from ccr_host.core.arrays import Array, split
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import identified_rests
from ccr_host.robot.workspace import MotorLimits, Nearest, Workspace, axes_of

_MOST_STEPS = 100
_STANDS_RAD = 1e-7
_CURE = "ccr-host calibrate --identify --robot FILE, or leave --surface model"


class IdentifiedSurface:
    """The rests of the likeliest static model, without friction and backlash.

    A point has the pose next to the one that (10) reaches it with: Gauss-Newton in the coordinates
    given, while the tip keeps the third. Where motor limits do not allow that pose, the motors go
    as far as they may. The frame is that of (10): how far the camera is turned, according to the
    fit, is taken out. The description has the section ``[identified]``.

    Raises:
        ConfigError: there are no such rests, they are another robot's, or do not fit this one.
    """

    def __init__(self, description: Description) -> None:
        if description.robot.segments:
            raise ConfigError(
                "--surface robot knows only robots of two planar segments with a motor each",
                "leave --surface model, to which [[robot.segments]] belongs as identify writes it",
            )
        rests = identified_rests(description)
        if rests is None:
            raise ConfigError("--surface robot needs the rests of section identified", _CURE)
        self._model = make_model(description.control)
        found = identification_of(Scaling.of(description), rests, self._model)
        if found is None:
            raise ConfigError("the rests in section identified do not fit [robot]", _CURE)
        fit = found.finish()
        self._p = fit.scaling.parameters(fit.result().score)
        self._limits = MotorLimits.of(description.servo)
        self._described = Workspace(ConstantCurvature(description.robot), self._limits)

    @property
    def length_mm(self) -> float:
        return self._described.length_mm

    def nearest(self, points_mm: ArrayLike) -> Nearest:
        points = np.asarray(points_mm, dtype=np.float64)
        axes = axes_of(points)
        theta = self._rests_rad(self._described.nearest(points).q_rad)
        for _ in range(_MOST_STEPS):
            target = straight_tip_mm(self._p, *split(theta))
            target[:, axes] = points
            before, theta = theta, self._model.polished(self._p, theta, target, 1)
            if np.abs(theta - before).max() < _STANDS_RAD:
                break
        q_rad = self._limits.clip(unhindered_setpoints_for(self._p, theta))
        tip_mm = straight_tip_mm(self._p, *split(self._rests_rad(q_rad)))
        # Points near the largest float overflow to infinite distance, which is acceptable.
        with np.errstate(over="ignore"):
            miss_mm = np.linalg.norm(tip_mm[:, axes] - points, axis=1)
        return Nearest(q_rad, tip_mm, miss_mm)

    def along(self, points_mm: ArrayLike) -> Nearest:
        return self.nearest(points_mm)

    def _rests_rad(self, q_rad: Array) -> Array:
        """Bending angles at rest, (N, 2), for motor angles, (N, 2)."""
        return first_pose(self._p, *split(q_rad)).theta_rad
