"""Derivatives of the tip at rest in parameters and setpoints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.identification import Scaling
from ccr_host.control.adaptive.motion import Rest
from ccr_host.control.adaptive.parameters import COUNT, FloatArray
from ccr_host.control.adaptive.statics import forces_at
from ccr_host.control.adaptive.tip import tip_at, vector_mm

PROBE = 1e-5


class Sensitivity(NamedTuple):
    """Columns are the scores, then time: ``tip`` (3, COUNT + 1), ``theta_rad`` (2, COUNT + 1)."""

    tip: FloatArray
    theta_rad: FloatArray


def sensitivity(
    scaling: Scaling, score: FloatArray, rest: Rest, rate_rad_s: FloatArray
) -> Sensitivity:
    """By the implicit function theorem.

    At rest g(theta, p) = 0, so dtheta = -g_theta^-1 g_p dp and df = f_p dp + f_theta dtheta. What
    friction holds hardly yields.

    Args:
        scaling: of the scores.
        score: of the parameters, (COUNT,).
        rest: the pose.
        rate_rad_s: of the setpoints, (2,), which makes the last column a speed.
    """
    drive, theta = rest
    here = scaling.parameters(score)
    near = scaling.perturbed(score, PROBE)
    setpoints = np.repeat(drive.setpoint_rad[None], COUNT + 1, axis=0)
    setpoints[-1] += PROBE * rate_rad_s
    moved = forces_at(near, theta, drive._replace(setpoint_rad=setpoints))
    forces = forces_at(here, theta, drive)
    moment_1, moment_2 = moved.moment_1 - forces.moment_1, moved.moment_2 - forces.moment_2
    k_11, k_12, k_22 = forces.stiffness_11, forces.stiffness_12, forces.stiffness_22
    determinant = k_11 * k_22 - k_12 * k_12
    yielding = np.stack(
        [
            (k_12 * moment_2 - k_22 * moment_1) / determinant,
            (k_12 * moment_1 - k_11 * moment_2) / determinant,
        ]
    )
    tip, tip_near = tip_at(here, theta), tip_at(near, theta)
    by_1 = vector_mm(here, 0.0, tip.sagittal_1)
    by_2 = vector_mm(here, tip.across_2, tip.sagittal_2)
    direct = vector_mm(near, tip_near.across, tip_near.sagittal).T
    change = direct - vector_mm(here, tip.across, tip.sagittal)[:, None]
    change += np.outer(by_1, yielding[0]) + np.outer(by_2, yielding[1])
    return Sensitivity(change / PROBE, yielding / PROBE)
