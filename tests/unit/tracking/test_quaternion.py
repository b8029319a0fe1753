import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.tracking.rotation import quaternion


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 1.0, 3.1, 6.0])
def test_quaternion_agrees_with_scipy(angle):
    vector = angle * np.array([0.6, -0.48, 0.64])
    w, x, y, z = quaternion(vector)
    assert w * w + x * x + y * y + z * z == pytest.approx(1, abs=1e-14)
    turned = Rotation.from_quat((x, y, z, w)) * Rotation.from_rotvec(vector).inv()
    assert turned.magnitude() < 1e-14
