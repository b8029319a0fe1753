import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.control.adaptive.model import PLAIN
from ccr_host.control.adaptive.motion import (
    _CREEP_TIME_S,
    first_pose,
    moved,
    predicted_mm,
    setpoint_for,
    turned,
)
from ccr_host.control.adaptive.parameters import COUNT, Scaling, parameters_of, prior_of
from ccr_host.control.adaptive.statics import STICKING, hold_of
from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.robot.rests import Rests
from ccr_host.sim.robot.mechanics import Mechanics

PRIOR = parameters_of(prior_of(Robot()).mean)
DRY = PRIOR._replace(friction_1=0.2)
LOOSE = PRIOR._replace(backlash_rad=0.02)
SCALING = Scaling(Robot())
CREEPING = PRIOR._replace(creep=0.1)
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


def test_a_new_bend_is_resisted_more_and_that_fades() -> None:
    p = CREEPING._replace(body_per_mm=0.0, tip_per_mm=0.0, sag_1=0.0, sag_2=0.0)
    start, end = first_pose(p, 0.0, 0.0), first_pose(p, 0.3, 0.6).theta_rad
    pose, left = moved(p, start, 0.3, 0.6), []
    for _ in range(3):
        left.append(end - pose.theta_rad)
        pose = moved(p, pose, 0.3, 0.6, 0.1 * _CREEP_TIME_S)
    # Where t (1 + c) = (wound - t) / compliance, in place of t.
    new = p.compliance_1 * p.creep / (1.0 + p.compliance_1 * (1.0 + p.creep))
    assert left[0] / end == pytest.approx(new, rel=1e-3)
    assert left[1] / left[0] == pytest.approx(np.exp(-0.1), abs=0.01)
    assert left[2] / left[1] == pytest.approx(np.exp(-0.1), abs=0.01)
    assert moved(p, pose, 0.3, 0.6, 1e9).theta_rad == pytest.approx(end, abs=1e-5)


def test_steps_of_a_motion_creep_as_the_whole_does() -> None:
    start = first_pose(CREEPING, 0.0, 0.0)
    whole, parts = moved(CREEPING, start, 0.4, -0.8, 4.0), start
    for share in (0.3, 0.6, 1.0):
        seconds = 4.0 * (share - parts.q_1 / 0.4)
        parts = moved(CREEPING, parts, 0.4 * share, -0.8 * share, seconds)
    assert parts.theta_rad == pytest.approx(whole.theta_rad, abs=5e-4)


@given(angles, angles)
def test_the_inverse_knows_how_far_the_segments_have_crept(way, aim):
    pose = moved(CREEPING, first_pose(CREEPING, 0.0, 0.0), *way, 2.0)
    hold = hold_of(CREEPING, *aim, pose.anchors, (0.0, 0.0))
    assert moved(CREEPING, pose, *hold.shafts).theta_rad == pytest.approx(aim, abs=1e-3)


def test_segments_creep_as_those_of_the_twin() -> None:
    there, waits_s = np.radians([0.0, 40.0]), (0.5, 2.0, 5.0)

    def bends_of(twin):
        mechanics = Mechanics(twin, 0.0)
        mechanics.pull(there)
        for wait_s in waits_s:
            mechanics.advance(round(wait_s * 1e6) // mechanics.step_us)
            yield _second_bend_rad(mechanics)

    times_s = _CREEP_TIME_S, 60.0
    creeping = Twin(creep_share=(CREEPING.creep, 0.0), creep_time_s=times_s, gravity_m_s2=0.0)
    missing = np.subtract([*bends_of(Twin(gravity_m_s2=0.0))], [*bends_of(creeping)])
    pose, end = first_pose(CREEPING, 0.0, 0.0), first_pose(CREEPING, *there)
    for wait_s, twin_missing in zip(waits_s, missing, strict=True):
        pose = moved(CREEPING, pose, *there, wait_s)
        assert end.theta_2 - pose.theta_2 == pytest.approx(twin_missing, rel=0.2)


def _second_bend_rad(mechanics):
    disks = mechanics.backbone_mm()
    first, last = disks[-6] - disks[-7], disks[-1] - disks[-2]
    cosine = first @ last / np.linalg.norm(first) / np.linalg.norm(last)
    return float(np.arccos(cosine)) * 5.0 / 4.5


def test_slopes_along_a_tour_are_those_of_robots_that_make_it_each_alone():
    """But for one robot of a hundred, which comes to rest where a tendon just slides or sticks."""
    agree = [_slopes_agree(seed) for seed in range(30)]
    assert np.mean(agree) > 0.96


def _slopes_agree(seed: int) -> bool:
    rng = np.random.default_rng(seed)
    score = SCALING.bounded(0.7 * rng.standard_normal(COUNT))
    from_rad, q_rad = rng.uniform(-1.2, 1.2, (2, 3, 2))
    time_s = rng.uniform(0.3, 5.0, 3).cumsum()
    rests = Rests.of_vectors(from_rad, q_rad, np.zeros((3, 2, 3)), np.ones(3), time_s)
    here_mm, slopes = PLAIN.predicted_and_slopes(SCALING, score, rests)
    assert here_mm == pytest.approx(predicted_mm(SCALING.parameters(score), rests), abs=1e-9)
    sides = [predicted_mm(SCALING.perturbed(score, step), rests) for step in (1e-5, -1e-5)]
    expected = np.moveaxis(sides[0] - sides[1], 1, -1)[..., :-1] / 2e-5
    return np.allclose(slopes, expected, rtol=0.0, atol=1e-3)
