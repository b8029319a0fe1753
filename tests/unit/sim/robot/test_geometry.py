"""The twin without gravity and slack against the paper's (10)."""

import mujoco
import numpy as np
import pytest

from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.sim.robot.mjcf import robot_mjcf

IDEAL = {
    "gravity_m_s2": 0.0,
    "slack_mm": 0.0,
    "bending_stiffness_nm_rad": 0.002,
    "tendon_stiffness_n_m": 20_000.0,
    "joint_damping": 4e-4,
}
"""Tendons that hardly stretch against a structure that hardly resists."""


def deviation_mm(robot) -> float:
    model = ConstantCurvature(Robot())
    return float(np.linalg.norm(robot.tip_mm() - model.tip_mm(robot.servo_angles_rad())))


def test_straight_robot_lies_along_minus_y(posed):
    robot = posed(**IDEAL)
    np.testing.assert_allclose(robot.tip_mm(), (0, -102, 0), atol=1e-6)
    np.testing.assert_allclose(
        robot.markers_mm(), [(0, 0, 15), (0, -58.5, 15), (0, -102, 15)], atol=1e-6
    )


def test_positive_first_angle_lifts_the_tip(tip):
    x, y, z = tip(15, 0, **IDEAL)
    assert x == pytest.approx(0, abs=1e-6)
    assert y > -102
    assert z > 30


def test_positive_second_angle_moves_the_tip_towards_plus_x(tip):
    x, y, z = tip(0, 15, **IDEAL)
    assert x > 10
    assert y > -102
    assert z == pytest.approx(0, abs=0.01)


@pytest.mark.long
@pytest.mark.parametrize("angles_deg", [(20, 0), (0, 20), (15, -25), (-20, 30)])
def test_tip_approaches_10_with_more_flexures(posed, angles_deg):
    coarse = deviation_mm(posed(*angles_deg, **IDEAL, flexures=(6, 5)))
    fine = deviation_mm(posed(*angles_deg, **IDEAL, flexures=(12, 10)))
    assert coarse < 3.2
    assert fine < 0.45 * coarse


def test_opposite_second_angle_mirrors_the_tip(tip):
    np.testing.assert_allclose(tip(12, -20, **IDEAL), tip(12, 20, **IDEAL) * (-1, 1, 1), atol=1e-3)


def test_opposite_first_angle_mirrors_the_backbone(posed):
    up, down = (posed(angle, 20, **IDEAL).backbone_mm() for angle in (12, -12))
    np.testing.assert_allclose(down, up * (1, 1, -1), atol=1e-3)


def test_backbone_has_its_length_and_one_point_a_disk(posed):
    backbone = posed(10, 20, flexures=(6, 5)).backbone_mm()
    assert backbone.shape == (12, 3)
    lengths = np.linalg.norm(np.diff(backbone, axis=0), axis=1)
    # A flexure between two disks shortens the straight line between their centres.
    assert 0.97 * 102 < lengths.sum() < 102


def test_markers_stand_off_the_backbone(posed):
    robot = posed(10, 20, marker_offset_mm=17.0, flexures=(4, 3))
    backbone = robot.backbone_mm()[[0, 4, 7]]
    np.testing.assert_allclose(np.linalg.norm(robot.markers_mm() - backbone, axis=1), 17.0)


def test_markers_stand_off_the_backbone_in_any_direction(posed):
    straight = posed(gravity_m_s2=0.0, marker_offset_mm=(2.0, -3.0, 14.0))
    np.testing.assert_allclose(
        straight.markers_mm() - straight.backbone_mm()[[0, 6, 11]], [(2, -3, 14)] * 3, atol=1e-6
    )
    bent = posed(10, 20, marker_offset_mm=(2.0, -3.0, 14.0))
    offsets_mm = bent.markers_mm() - bent.backbone_mm()[[0, 6, 11]]
    np.testing.assert_allclose(np.linalg.norm(offsets_mm, axis=1), np.sqrt(4 + 9 + 196))
    np.testing.assert_array_equal(bent.tip_mm(), bent.markers_mm()[2] - bent.markers_mm()[0])


def test_marker_offset_turns_with_the_first_segment(tip):
    """(10): d_m moves the tip vector by d (sin theta_1, cos theta_1 - 1)."""
    near, far = (tip(20, 0, **IDEAL, marker_offset_mm=d_mm) for d_mm in (0.0, 30.0))
    _, sine, cosine = (far - near) / 30.0 + (0, 0, 1)
    assert np.hypot(sine, cosine) == pytest.approx(1.0, rel=1e-3)
    assert np.arctan2(sine, cosine) == pytest.approx(np.radians(20) * 12.5 / 4.5, rel=0.06)


def test_moving_mass_is_that_of_disks_and_two_markers():
    model = mujoco.MjModel.from_xml_string(
        robot_mjcf(Twin(flexures=(4, 3), disk_mass_g=1.5, marker_mass_g=2.0))
    )
    assert model.body_mass.sum() == pytest.approx((7 * 1.5 + 2 * 2.0) * 1e-3)
