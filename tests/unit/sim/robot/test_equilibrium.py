"""Rest poses of the twin."""

import numpy as np
import pytest

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium
from ccr_host.sim.robot.mechanics import Mechanics


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {
            "gravity_m_s2": (5.0, 6.0, -6.0),
            "axial_stiffness_n_m": (8000.0, 5000.0),
            "torsion_stiffness_nm_rad": (0.05, 0.08),
            "sideways_stiffness_nm_rad": (0.2, 0.1),
            "stiffness_taper": (0.2, -0.1),
            "stiffening": (0.3, 0.5),
            "bending_plane_turn_deg": (2.0, -3.0),
            "marker_offset_mm": (1.0, 2.0, 14.0),
            "creep_share": 0.3,
            "creep_time_s": 0.2,
        },
    ],
)
def test_rest_poses_are_those_reached_by_the_simulation(keys):
    twin = Twin(friction=0.0, joint_damping=2e-3, **keys)
    mechanics = Mechanics(twin, 0.0)
    mechanics.pull((0.3, -0.5))
    mechanics.advance(round(6e6 / mechanics.step_us))
    markers = mechanics.markers_mm()
    rest_mm = Equilibrium(twin).tip_mm((0.3, -0.5))
    assert rest_mm == pytest.approx(markers[2] - markers[0], abs=1e-3)


def test_a_rest_pose_does_not_depend_on_the_way_to_it():
    for twin in (Twin(), Twin(slack_mm=0.2, payload_g=5.0, bending_stiffness_nm_rad=(0.012, 0.02))):
        walked = Equilibrium(twin)
        for angles_deg in ((-40, -60), (-36, 50), (40, 60), (-20, 20), (36, -56)):
            motor_rad = np.radians(angles_deg)
            direct_mm = Equilibrium(twin).tip_mm(motor_rad)
            assert walked.tip_mm(motor_rad) == pytest.approx(direct_mm, abs=1e-3)
