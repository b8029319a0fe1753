import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ccr_host.config import Robot, Twin
from ccr_host.control.adaptive.statics import (
    Drive,
    Parameters,
    likely_bending_rad,
    parameters_of,
    pose_at,
    prior_of,
    rest_at,
    setpoints_for,
    tip_at,
    tip_jacobian_mm_rad,
    tip_mm,
)
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.twin.static_map import Equilibrium

PRIOR = parameters_of(prior_of(Robot()).mean)
HINDERED = PRIOR._replace(play_rad=0.01, friction_1=0.1, friction_2=0.05, turn_x_rad=0.03)
STILL = np.zeros(2)
bends = st.tuples(st.floats(-1.9, 1.9), st.floats(-2.2, 2.2)).map(np.array)
sides = st.sampled_from([-1.0, 0.0, 1.0])


@given(bends)
def test_stiffness_is_the_derivative_of_the_moments(theta):
    drive, h = Drive(np.array([0.3, -0.5]), STILL), 1e-6
    here = pose_at(PRIOR, theta, drive)
    by_1 = pose_at(PRIOR, theta + np.array([h, 0.0]), drive)
    by_2 = pose_at(PRIOR, theta + np.array([0.0, h]), drive)
    assert (by_1.moment_1 - here.moment_1) / h == pytest.approx(here.stiffness_11, abs=1e-3)
    assert (by_1.moment_2 - here.moment_2) / h == pytest.approx(here.stiffness_12, abs=1e-3)
    assert (by_2.moment_1 - here.moment_1) / h == pytest.approx(here.stiffness_12, abs=1e-3)
    assert (by_2.moment_2 - here.moment_2) / h == pytest.approx(here.stiffness_22, abs=1e-3)


@given(bends, st.tuples(sides, sides).map(np.array))
def test_setpoints_put_the_robot_at_rest_where_they_are_meant_to(theta, side):
    setpoint = setpoints_for(HINDERED, theta, side)
    drive = Drive(setpoint, side)
    assert rest_at(HINDERED, drive, theta) == pytest.approx(theta, abs=0.01)


@given(bends)
def test_one_pose_and_many_agree(theta):
    drive = Drive(np.array([0.2, 0.4]), np.ones(2))
    many = Drive(np.array([drive.setpoint_rad] * 2), np.ones((2, 2)))
    one = pose_at(HINDERED, theta, drive)
    two = pose_at(HINDERED, np.array([theta, theta]), many)
    assert two.moment_1[1] == pytest.approx(one.moment_1, abs=1e-9)
    assert two.tip.sagittal[0] == pytest.approx(one.tip.sagittal, abs=1e-9)


@given(bends)
def test_without_weight_and_sag_the_tip_is_that_of_equation_10(theta):
    ideal = PRIOR._replace(body_per_mm=0.0, tip_per_mm=0.0, sag_1=0.0, sag_2=0.0)
    model = ConstantCurvature(Robot())
    expected = model.tip_mm(theta / model.bending_per_motor)
    assert tip_mm(ideal, theta) == pytest.approx(expected, abs=1e-9)


@given(bends)
def test_jacobian_is_the_derivative_of_the_tip(theta):
    h = 1e-6
    assume(np.abs(theta).min() > 1e-3)
    jacobian = tip_jacobian_mm_rad(PRIOR, tip_at(PRIOR, theta))
    moved = [
        (tip_mm(PRIOR, theta + h * e) - tip_mm(PRIOR, theta - h * e)) / 2 / h for e in np.eye(2)
    ]
    assert jacobian == pytest.approx(np.array(moved).T, abs=1e-3)


def test_slack_hides_small_motor_angles_of_a_robot_that_weighs_nothing():
    light = PRIOR._replace(body_per_mm=0.0, tip_per_mm=0.0, slack_1_rad=0.1, slack_2_rad=0.1)
    inside, outside = (Drive(np.full(2, q), STILL) for q in (0.09, 0.15))
    assert rest_at(light, inside, STILL) == pytest.approx(STILL, abs=1e-9)
    assert np.all(rest_at(light, outside, STILL) > 0.05)


def test_known_parameters_predict_a_weightless_twin_within_a_tenth_of_a_millimetre():
    twin = Twin(gravity_m_s2=0.0)
    compliance = 20.0 / (4.0 * 4.5**2)
    sags = [length / (8 * n**2 * 4.5) for length, n in zip((58.5, 43.5), (6, 5), strict=True)]
    known = Parameters(
        58.5, 43.5, 15.0, 12.5 / 4.5, 12.5 / 4.5, compliance, compliance, 1.2 / 12.5, 1.2 / 12.5,
        *sags, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    equilibrium = Equilibrium(twin)
    for q in np.radians([[20.0, 30.0], [-30.0, 50.0], [10.0, -45.0], [3.0, 60.0]]):
        rest = rest_at(known, Drive(q, STILL), likely_bending_rad(known, q))
        assert tip_mm(known, rest) == pytest.approx(equilibrium.tip_mm(*q), abs=0.1)
