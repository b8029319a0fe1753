import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.control.adaptive.motion import first_pose, setpoint_for
from ccr_host.control.adaptive.parameters import Parameters, parameters_of, prior_of
from ccr_host.control.adaptive.statics import (
    forces_of,
    hold_of,
    likely_of,
    settled,
    strains_of,
    unhindered_setpoints_for,
)
from ccr_host.control.adaptive.tip import seen_of, tip_mm, tip_of, turned_back_mm
from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.sim.robot.equilibrium import Equilibrium

PRIOR = parameters_of(prior_of(Robot()).mean)
HINDERED = PRIOR._replace(
    backlash_rad=0.01,
    friction_1=0.1,
    friction_ratio=0.5,
    turn_x_rad=0.03,
    push_x_per_mm=0.002,
    push_y_per_mm=-0.001,
    shortening=0.15,
    creep=0.07,
)
SOFT = PRIOR._replace(shortening=0.1, sideways=0.02, twisting=0.25, plane_1_rad=0.02)
STILL = np.zeros(2)
ASKEW = HINDERED._replace(up_x=-0.48, up_y=0.6, up_z=-0.64)
ups = st.sampled_from(
    [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.64, 0.48)]
)
bends = st.tuples(st.floats(-1.9, 1.9), st.floats(-2.2, 2.2)).map(np.array)
senses = st.tuples(*[st.sampled_from([-1.0, 1.0])] * 2).map(np.array)


def _anchors(p, theta, slid=0.1):
    return tuple(route + slid for route in strains_of(p, *theta))


@given(bends, st.sampled_from([0.1, 0.002]), st.sampled_from([HINDERED, ASKEW]))
def test_stiffness_is_the_derivative_of_the_moments_sliding_and_sticking(theta, slid, p):
    held, h = ((0.3, -0.5), _anchors(p, theta, slid)), 1e-7
    here = forces_of(p, *theta, *held)
    by_1 = forces_of(p, *(theta + np.array([h, 0.0])), *held)
    by_2 = forces_of(p, *(theta + np.array([0.0, h])), *held)
    assert (by_1.moment_1 - here.moment_1) / h == pytest.approx(here.stiffness_11, abs=1e-2)
    assert (by_1.moment_2 - here.moment_2) / h == pytest.approx(here.stiffness_12, abs=1e-2)
    assert (by_2.moment_1 - here.moment_1) / h == pytest.approx(here.stiffness_12, abs=1e-2)
    assert (by_2.moment_2 - here.moment_2) / h == pytest.approx(here.stiffness_22, abs=1e-2)


@given(bends, ups, st.floats(0.0, 0.01), st.sampled_from([0.0, 0.01]))
def test_a_weight_on_the_tip_pulls_down_whichever_way_the_robot_is_mounted(theta, up, tip, body):
    """Its moments are the slopes of its height, and no push is needed to hold it up.

    It is lower than on segments that bend evenly, as that makes the energy least.
    """
    bare = PRIOR._replace(body_per_mm=body, sag_1=0.0, sag_2=0.0)
    bare = bare._replace(**dict(zip(("up_x", "up_y", "up_z"), up, strict=True)))
    lighter, here, heavier = (bare._replace(tip_per_mm=tip + more) for more in (-1e-4, 0.0, 1e-4))
    routes, h = strains_of(bare, *theta), 1e-6
    less, more = (forces_of(p, *theta, (0.0, 0.0), routes)[:2] for p in (lighter, heavier))
    slopes = [
        (tip_mm(here, *(theta + h * e)) - tip_mm(here, *(theta - h * e))) @ up / (2.0 * h)
        for e in np.eye(2)
    ]
    assert np.subtract(more, less) / 2e-4 == pytest.approx(slopes, abs=1e-5)


@given(bends, ups)
def test_the_pushes_are_level_and_at_right_angles_however_the_robot_is_mounted(theta, up):
    """Work per bending angle of both pushes and of a pull upwards: an orthonormal frame's."""
    bare = PRIOR._replace(
        body_per_mm=0.0, tip_per_mm=0.0, sag_1=0.0, sag_2=0.0, marker_offset_mm=0.0
    )
    bare = bare._replace(**dict(zip(("up_x", "up_y", "up_z"), up, strict=True)))
    routes, force, h = strains_of(bare, *theta), 1e-3, 1e-6

    def moments(**loads):
        return np.array(forces_of(bare._replace(**loads), *theta, (0.0, 0.0), routes)[:2])

    work = [
        (moments() - moments(push_x_per_mm=force)) / force,
        (moments() - moments(push_y_per_mm=force)) / force,
        (moments(tip_per_mm=force) - moments(tip_per_mm=-force)) / (2.0 * force),
    ]
    motion = [
        (tip_mm(bare, *(theta + h * e)) - tip_mm(bare, *(theta - h * e))) / (2.0 * h)
        for e in np.eye(2)
    ]
    gram = np.transpose(work) @ np.array(work)
    assert gram == pytest.approx(np.array(motion) @ np.transpose(motion), rel=1e-4, abs=1e-3)


@given(bends, senses)
def test_shafts_put_the_robot_at_rest_where_they_are_meant_to(theta, sense):
    start = theta - 0.05 * sense
    anchors = strains_of(HINDERED, *start)
    shafts = hold_of(HINDERED, *theta, anchors, (0.0, 0.0)).shafts
    assert settled(HINDERED, *start, shafts, anchors) == pytest.approx(theta, abs=1e-4)


@given(bends)
def test_the_tendon_that_pulls_goes_on_until_the_other_one_clearly_has_to(theta):
    anchors = strains_of(PRIOR, *theta)
    free = hold_of(PRIOR, *theta, anchors, (0.0, 0.0))
    kept = hold_of(PRIOR, *theta, anchors, tuple(-side for side in free.sides))
    assert settled(PRIOR, *theta, kept.shafts, anchors) == pytest.approx(theta, abs=0.02)


@given(bends)
def test_one_pose_and_many_agree(theta):
    shafts, anchors = (0.2, 0.4), _anchors(HINDERED, theta)
    one = forces_of(HINDERED, *theta, shafts, anchors)
    both = np.stack([theta, theta], axis=-1)
    two = forces_of(HINDERED, *both, shafts, anchors)
    assert two.moment_1[1] == pytest.approx(one.moment_1, abs=1e-9)
    first, second = settled(HINDERED, *both, shafts, anchors)
    rest = settled(HINDERED, *theta, shafts, anchors)
    assert (first[0], second[0]) == pytest.approx(rest, abs=1e-6)


@given(bends)
def test_without_weight_and_sag_the_tip_is_that_of_equation_10(theta):
    ideal = PRIOR._replace(body_per_mm=0.0, tip_per_mm=0.0, sag_1=0.0, sag_2=0.0)
    robot = Robot()
    q = np.multiply(theta, robot.tendon_radius_mm / robot.pulley_radius_mm)
    expected = ConstantCurvature(robot).tip_mm(q)
    assert tip_mm(ideal, *theta) == pytest.approx(expected, abs=1e-9)


@given(
    bends.map(lambda theta: theta + np.copysign(1e-3, theta)),
    st.sampled_from([PRIOR, SOFT, SOFT._replace(up_x=0.6, up_y=0.64, up_z=-0.48)]),
)
def test_jacobian_is_the_derivative_of_the_tip(theta, p):
    h = 1e-6
    tip = tip_of(p, *theta)
    by_1 = seen_of(p, tip.across_1, tip.sagittal_1)
    by_2 = seen_of(p, tip.across_2, tip.sagittal_2)
    moved = [(tip_mm(p, *(theta + h * e)) - tip_mm(p, *(theta - h * e))) / 2 / h for e in np.eye(2)]
    assert np.array([by_1, by_2]) == pytest.approx(np.array(moved), abs=1e-3)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (9.81, 0.0, 0.0), (-4.0, 5.0, 7.0)])
def test_a_segment_gives_way_to_its_side_as_the_twin_does(gravity):
    """It is twisted by what hangs beside it, and bent by its weight and by motor 2's tendon."""
    give = {"torsion_stiffness_nm_rad": (0.08, 80.0), "sideways_stiffness_nm_rad": (1.0, 1000.0)}
    g = np.linalg.norm(gravity)
    bare = Twin(gravity_m_s2=gravity)
    stiff, soft = (Equilibrium(t) for t in (bare, bare.model_copy(update=give)))
    per_g = 1e-6 * g / bare.bending_stiffness_nm_rad[0]
    p = PRIOR._replace(
        slack_1_rad=0.096,
        slack_2_rad=0.096,
        sag_1=58.5 / (8 * 6**2 * 4.5),
        sag_2=43.5 / (8 * 5**2 * 4.5),
        body_per_mm=(11.0 * bare.disk_mass_g + bare.marker_mass_g) * per_g,
        tip_per_mm=bare.marker_mass_g * per_g,
        **dict(zip(("up_x", "up_y", "up_z"), -np.array(gravity) / g, strict=True)),
    )
    for q in np.radians([[30.0, 30.0], [-25.0, 35.0], [35.0, -30.0], [35.0, 10.0]]):
        moved_mm = soft.tip_mm(q) - stiff.tip_mm(q)
        theta = settled(p, *likely_of(p, *q), tuple(q), _anchors(p, STILL))
        given = tip_mm(p._replace(twisting=0.25, sideways=0.02), *theta) - tip_mm(p, *theta)
        off_mm = np.linalg.norm(given - moved_mm)
        assert off_mm < 0.3 * np.linalg.norm(moved_mm) + 0.2


def test_turning_a_vector_into_the_cameras_frame_and_back_changes_nothing():
    turned = PRIOR._replace(turn_x_rad=0.05, turn_y_rad=-0.08, turn_z_rad=0.02)
    point = np.array([10.0, -90.0, 25.0])
    seen = seen_of(turned, point[0], -point[1] + 1j * point[2])
    assert np.linalg.norm(seen) == pytest.approx(np.linalg.norm(point))
    assert turned_back_mm(turned, np.array(seen)) == pytest.approx(point)


def test_slack_hides_small_motor_angles_of_a_robot_that_weighs_nothing():
    light = PRIOR._replace(body_per_mm=0.0, tip_per_mm=0.0, slack_1_rad=0.1, slack_2_rad=0.1)
    assert first_pose(light, 0.09, 0.09).theta_rad == pytest.approx(STILL, abs=1e-9)
    assert np.all(first_pose(light, 0.15, 0.15).theta_rad > 0.05)


def test_known_parameters_predict_a_weightless_twin_within_a_tenth_of_a_millimetre():
    twin = Twin(gravity_m_s2=0.0)
    compliance = 20.0 / (4.0 * 4.5**2)
    sags = [length / (8 * n**2 * 4.5) for length, n in zip((58.5, 43.5), (6, 5), strict=True)]
    known = Parameters(
        58.5, 43.5, 15.0, 12.5 / 4.5, 1.0, compliance, compliance, 1.2 / 12.5, 1.2 / 12.5,
        *sags, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0,
    )  # fmt: skip
    equilibrium = Equilibrium(twin)
    for q in np.radians([[20.0, 30.0], [-30.0, 50.0], [10.0, -45.0], [3.0, 60.0]]):
        rest = settled(known, *likely_of(known, *q), tuple(q), _anchors(known, STILL))
        assert tip_mm(known, *rest) == pytest.approx(equilibrium.tip_mm(q), abs=0.1)


def test_a_backbone_that_its_tendons_shorten_is_predicted_as_well():
    """A backbone of 8 kN/m shortens by 1 mm and more, which slackens the tendons of both motors."""
    axial_n_m = 8000.0, 8000.0 * 58.5 / 43.5
    rigid, soft = Twin(gravity_m_s2=0.0), Twin(gravity_m_s2=0.0, axial_stiffness_n_m=axial_n_m)
    compliance = 20.0 / (4.0 * 4.5**2)
    sags = [length / (8 * n**2 * 4.5) for length, n in zip((58.5, 43.5), (6, 5), strict=True)]
    known = PRIOR._replace(
        compliance_1=compliance, compliance_2=compliance, slack_1_rad=0.096, slack_2_rad=0.096,
        sag_1=sags[0], sag_2=sags[1], body_per_mm=0.0, tip_per_mm=0.0,
        shortening=20.0 / (8.0 * 4.5**2),
    )  # fmt: skip
    for q in np.radians([[20.0, 30.0], [-30.0, 50.0], [10.0, -45.0]]):
        there = Equilibrium(soft).tip_mm(q)
        assert np.linalg.norm(there - Equilibrium(rigid).tip_mm(q)) > 1.0
        rest = settled(known, *likely_of(known, *q), tuple(q), _anchors(known, STILL))
        assert tip_mm(known, *rest) == pytest.approx(there, abs=0.25)


def test_unequal_slack_of_a_pair_is_an_offset_of_its_servo():
    """Tendons of 1.0 and 0.4 mm, against both of 0.7 mm and a servo that is off by 0.3 mm."""
    unequal, off_rad = Twin(slack_mm=(1.0, 1.2, 0.4, 1.2)), 0.3 / 12.5
    equal = Twin(slack_mm=(0.7, 1.2, 0.7, 1.2))
    for q_1, q_2 in np.radians([[20.0, 30.0], [-30.0, 50.0], [10.0, -45.0]]):
        there = Equilibrium(unequal).tip_mm((q_1, q_2))
        assert there == pytest.approx(Equilibrium(equal).tip_mm((q_1 - off_rad, q_2)), abs=1e-3)


def test_a_zero_shifts_the_setpoints_and_nothing_else():
    off = PRIOR._replace(zero_1_rad=0.05, zero_2_rad=-0.03)
    shift = np.array([0.05, -0.03])
    for q in np.radians([[20.0, 30.0], [-30.0, 50.0], [0.0, 3.0]]):
        there = first_pose(off, *(q + shift)).theta_rad
        assert there == pytest.approx(first_pose(PRIOR, *q).theta_rad)
    theta = np.array([0.4, -0.6])
    assert unhindered_setpoints_for(off, theta) == pytest.approx(
        unhindered_setpoints_for(PRIOR, theta) + shift
    )
    pose = first_pose(off, *np.radians([20.0, 30.0]))
    assert setpoint_for(off, pose, (0.5, -0.5)) == pytest.approx(np.array([0.5, -0.5]) + shift)
