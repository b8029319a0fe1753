"""How long a step the explicit springs of the structure allow."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def linear_step_limit_s(
    model: mujoco.MjModel, data: mujoco.MjData, tendon_stiffness_n_m: float
) -> float:
    """Longest stable step h about the pose of ``data``, all tendons taut.

    Semi-implicit Euler with implicit damping is stable while 4 M + 2 h C - h^2 K is positive
    definite (M inertia, C damping, K stiffness). ``data`` must be up to date (mj_forward).
    """
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    damping = np.diag(model.dof_damping)
    routes = _tendon_jacobian(model, data)
    stiffness = np.diag(model.jnt_stiffness) + tendon_stiffness_n_m * routes.T @ routes
    stable_s, unstable_s = 1e-9, 1.0
    while unstable_s > 1.001 * stable_s:
        step_s = float(np.sqrt(stable_s * unstable_s))
        margin = 4 * inertia + 2 * step_s * damping - step_s**2 * stiffness
        if np.linalg.eigvalsh(margin)[0] > 0:
            stable_s = step_s
        else:
            unstable_s = step_s
    return stable_s


def _tendon_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """(tendons, joints): change of the tendons' lengths with the joint angles, m/rad."""
    jacobian = np.zeros((model.ntendon, model.nv))
    for row, (start, count) in enumerate(zip(model.ten_J_rowadr, model.ten_J_rownnz, strict=True)):
        columns = model.ten_J_colind[start : start + count]
        jacobian[row, columns] = data.ten_J[start : start + count]
    return jacobian
