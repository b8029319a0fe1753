import mujoco
import numpy as np
import pytest

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import linear_step_limit_s
from ccr_host.sim.robot.mjcf import robot_mjcf


def small_motion_grows(twin: Twin, step_s: float) -> bool:
    """Disturb the straight robot a little, with both pairs of tendons pretensioned."""
    model = mujoco.MjModel.from_xml_string(robot_mjcf(twin))
    model.opt.timestep = step_s
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.ctrl[:] = data.ten_length - 1e-5
    data.qpos[:] = 1e-9 * (-1.0) ** np.arange(model.nq)
    for _ in range(400):
        mujoco.mj_step(model, data, nstep=5)
        if np.abs(data.qpos).max() > 1e-8:
            return True
    return False


@pytest.mark.parametrize("joint_damping", [0.0, 2e-5, 2e-4])
@pytest.mark.parametrize("stiffness", [0.02, 0.2])
def test_limit_separates_decay_from_growth(joint_damping, stiffness):
    twin = Twin(joint_damping=joint_damping, bending_stiffness_nm_rad=stiffness, gravity_m_s2=0.0)
    model = mujoco.MjModel.from_xml_string(robot_mjcf(twin))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    limit_s = linear_step_limit_s(model, data, twin.tendon_stiffness_n_m)
    assert not small_motion_grows(twin, 0.95 * limit_s)
    assert small_motion_grows(twin, 1.05 * limit_s)
