"""Rest poses of twins, seen by a turned camera."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Servo
from ccr_host.description.simulation import Twin
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.tools.register import safe_poses_rad

TURNS = {
    "aligned": (0.0, 0.0, 0.0),
    "half turn": (0.0, 0.0, np.pi),
    "upside down": (np.pi, 0.0, 0.0),
    "askew": (1.2, -0.7, 2.0),
}
WELL_DAMPED = {"joint_damping": 4e-3}
"""Twenty times the default: at rest within two seconds, at the same place."""


def poses_rad() -> np.ndarray:
    return safe_poses_rad(MotorLimits.of(Servo()))


@cache
def markers_at_rest(**keys) -> np.ndarray:
    """(K, 3, 3): of a twin in the safe poses."""
    robot = TwinRobot(Twin(**(WELL_DAMPED | keys)))
    markers = []
    for number, angles_deg in enumerate(np.degrees(poses_rad())):
        first, second = (round(3000 + angle * 2000 / 90) for angle in angles_deg)
        robot.set_pulses_half_us((first, second))
        robot.advance_to((number + 1) * 2_000_000)
        markers.append(robot.markers_mm())
    return np.array(markers)


@pytest.fixture
def seen():
    """Rest poses as a camera turned by a rotation vector sees them."""

    def rests(turn=(0.0, 0.0, 0.0), noise_mm=0.0, seed=1, **keys) -> Rests:
        rng = np.random.default_rng(seed)
        # The camera's frame turned by R shows R' p, as the twin's camera does.
        to_robot = Rotation.from_rotvec(turn).as_matrix()
        markers = markers_at_rest(**keys) @ to_robot + (30.0, -50.0, -900.0)
        noisy = markers + rng.normal(0.0, noise_mm, markers.shape)
        return Rests(np.zeros(2), poses_rad(), noisy, np.ones(len(noisy)))

    return rests
