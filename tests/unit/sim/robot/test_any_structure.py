"""Any combination of the structure's keys within plausible ranges can be simulated."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium
from ccr_host.sim.robot.mechanics import Mechanics


def both(low: float, high: float) -> st.SearchStrategy:
    return st.tuples(*[st.floats(low, high)] * 2)


KEYS = {
    "joint_damping": st.floats(6e-4, 5e-3),
    "capstan_friction": st.floats(0, 0.5),
    "friction": st.floats(0, 0.5),
    "creep_share": both(0, 0.3),
    "creep_time_s": both(0.1, 100),
    "stiffness_taper": both(-0.5, 0.5),
    "stiffening": both(0, 1),
    "bending_plane_turn_deg": both(-10, 10),
    "sideways_stiffness_nm_rad": both(0.05, 10),
    "torsion_stiffness_nm_rad": both(0.02, 10),
    "axial_stiffness_n_m": both(2e3, 1e6),
    "slack_mm": st.tuples(*[st.floats(0, 2)] * 4),
    "gravity_m_s2": st.tuples(*[st.floats(-9.81, 9.81)] * 3),
    "marker_offset_mm": st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(5, 25)),
    "bending_stiffness_nm_rad": both(0.012, 0.04),
    "tendon_stiffness_n_m": st.floats(1e3, 2e4),
    "flexures": st.tuples(st.integers(3, 8), st.integers(3, 8)),
}
"""Ranges of printed robots of about the paper's size."""


def kinetic_j(mechanics: Mechanics) -> float:
    inertia = np.zeros((mechanics._model.nv, mechanics._model.nv))
    mujoco.mj_fullM(mechanics._model, mechanics._data, inertia)
    speeds = mechanics._data.qvel
    return float(0.5 * speeds @ inertia @ speeds)


@pytest.mark.long
@given(
    st.fixed_dictionaries({}, optional=KEYS),
    st.lists(st.tuples(*[st.floats(-1.2, 1.2)] * 2), min_size=3, max_size=3),
)
@settings(max_examples=15)
def test_any_structure_is_moved_for_a_second_and_then_comes_to_rest(keys, angles_rad):
    """No energy comes from nowhere: the motion dies away once the pulleys stand still."""
    mechanics = Mechanics(Twin(**({"joint_damping": 1.2e-3} | keys)), 0.0)
    steps = round(10_000 / mechanics.step_us)
    here = np.zeros(2)
    for there in angles_rad:
        for part in np.linspace(0, 1, 15):
            mechanics.pull(here + part * (np.array(there) - here))
            mechanics.advance(steps)
        here = np.array(there)
    peaks_j = []
    for _ in range(3):
        energies_j = []
        for _ in range(20):
            mechanics.advance(steps)
            energies_j.append(kinetic_j(mechanics))
        peaks_j.append(max(energies_j))
    assert np.isfinite(mechanics.markers_mm()).all()
    assert peaks_j[-1] < 0.5 * peaks_j[0] + 1e-7


@pytest.mark.parametrize("search", [lambda twin: Mechanics(twin, 0.0), Equilibrium])
def test_a_warning_of_mujoco_leaves_no_file_in_the_working_folder(search, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mujoco.set_mju_user_warning(None)
    search(Twin())
    text = "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = 1e99
    mujoco.mj_step(model, data)
    assert data.warning.number.any()
    assert not [*tmp_path.iterdir()]
