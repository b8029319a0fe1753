import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.control.adaptive.motion import first_pose, moved, setpoint_for, turned
from ccr_host.control.adaptive.parameters import parameters_of, prior_of
from ccr_host.control.adaptive.statics import STICKING, hold_of
from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import Mechanics

PRIOR = parameters_of(prior_of(Robot()).mean)
DRY = PRIOR._replace(friction_1=0.2)
LOOSE = PRIOR._replace(backlash_rad=0.02)
angles = st.tuples(st.floats(-0.7, 0.7), st.floats(-1.0, 1.0)).map(np.array)


@given(st.lists(angles, min_size=1, max_size=5), angles)
def test_a_rest_holds_however_the_robot_came_to_it(way, there):
    pose = first_pose(DRY, 0.0, 0.0)
    for setpoint in [*way, there]:
        pose = moved(DRY, pose, *setpoint)
    again = moved(DRY, pose, *(there + 1e-9))
    assert again.theta_rad == pytest.approx(pose.theta_rad, abs=1e-4)


def test_friction_leaves_a_loop_between_up_and_down():
    pose = first_pose(DRY, 0.0, 0.0)
    up = moved(DRY, pose, 0.0, 0.5)
    down = moved(DRY, moved(DRY, up, 0.0, 0.9), 0.0, 0.5)
    both_ways = 2.0 * DRY.friction_2 / (1.0 + 1.0 / DRY.compliance_2)
    assert down.theta_rad[1] - up.theta_rad[1] == pytest.approx(both_ways, rel=0.2)


def test_a_servo_with_play_stays_behind_on_the_side_it_comes_from():
    pose = moved(LOOSE, first_pose(LOOSE, 0.0, 0.0), 0.5, 0.5)
    assert pose[2:4] == pytest.approx((1.0, 1.0))
    half_back = moved(LOOSE, pose, 0.48, 0.48)
    assert half_back.theta_rad == pytest.approx(pose.theta_rad, abs=1e-6)
    assert moved(LOOSE, pose, 0.4, 0.4)[2:4] == pytest.approx((-1.0, -1.0))


@given(angles, angles)
def test_the_inverse_takes_up_the_play(way, aim):
    pose = moved(LOOSE, first_pose(LOOSE, 0.0, 0.0), *way)
    hold = hold_of(LOOSE, *aim, pose.anchors, (0.0, 0.0))
    setpoint = setpoint_for(LOOSE, pose, hold.shafts)
    # Less than 0.1 deg of a shaft may be left undone.
    assert moved(LOOSE, pose, *setpoint).theta_rad == pytest.approx(aim, abs=0.02)


def test_without_friction_what_holds_the_robot_is_known_without_its_pose():
    pose = first_pose(LOOSE, 0.0, 0.0)
    held, known = turned(LOOSE, pose, 0.3, -0.4), moved(LOOSE, pose, 0.3, -0.4)
    assert held[:4] == pytest.approx(known[:4])


def test_moving_segment_1_releases_segment_2_as_on_the_twin():
    """Tendons of segment 2 slide through bent segment 1, and then friction no longer holds it."""
    way = np.radians([[0.0, 30.0], [25.0, 30.0]])
    sags = [length / (8 * n**2 * 4.5) for length, n in zip((58.5, 43.5), (6, 5), strict=True)]
    p = PRIOR._replace(
        friction_1=0.225, body_per_mm=0.0, tip_per_mm=0.0, sag_1=sags[0], sag_2=sags[1],
        slack_1_rad=0.096, slack_2_rad=0.096, compliance_1=0.247, compliance_2=0.247,
    )  # fmt: skip
    mechanics, here = Mechanics(Twin(friction=0.5, gravity_m_s2=0.0), 0.0), np.zeros(2)
    pose, bends = first_pose(p, *here), []
    for there in way:
        for share in np.linspace(0.0, 1.0, 101):
            mechanics.pull(here + share * (there - here))
            mechanics.advance(20_000 // mechanics.step_us)
        here, pose = there, moved(p, pose, *there)
        bends.append((_second_bend_rad(mechanics), pose.theta_rad[1]))
    (twin_before, before), (twin_after, after) = bends
    assert before == pytest.approx(twin_before, abs=0.02)
    assert after == pytest.approx(twin_after, abs=0.02)
    assert twin_after - twin_before > 2.0 * STICKING


def _second_bend_rad(mechanics):
    disks = mechanics.backbone_mm()
    first, last = disks[-6] - disks[-7], disks[-1] - disks[-2]
    cosine = first @ last / np.linalg.norm(first) / np.linalg.norm(last)
    return float(np.arccos(cosine)) * 5.0 / 4.5
