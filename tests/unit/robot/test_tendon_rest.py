"""Rest of any robot on tendons, by its physical consequences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Robot, Segment, Tendon
from ccr_host.robot.chain import PAPER_FRAME, Weights, point_mm
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.tendon_rest import TendonRobot
from ccr_host.tools.chain_fit import ChainModel

STIFF = 1e-4
"""Compliance of tendons that hardly stretch."""


def three_tendons(segment: int, compliance: float = 0.1, **keys: float) -> Segment:
    """A spatial segment whose tendons are turned against those of the earlier ones."""
    tendons = tuple(
        Tendon(angle_deg=30.0 * segment + 120.0 * number, motor=3 * segment + number + 1)
        for number in range(3)
    )
    return Segment(
        length_mm=60.0, tendon_radius_mm=4.5, compliance=compliance, tendons=tendons, **keys
    )


def robot_of(*segments: Segment) -> TendonRobot:
    motors = max(tendon.motor for s in segments for tendon in s.tendons)
    model = ChainModel(segments, np.zeros((1, motors)))
    score = model.nothing
    for number, unknown in enumerate(model.unknowns):
        if unknown.kind == "dead_travel":
            score[number] = -unknown.mean / unknown.deviation
    return model.robot(score)


def random_travel(motors: int, rows: int = 40) -> np.ndarray:
    return np.random.default_rng(3).uniform(-2.0, 4.0, (rows, motors))


def test_at_rest_no_moment_is_left():
    robot = robot_of(three_tendons(0, sag=0.03), three_tendons(1, sag=0.02), three_tendons(2))
    travel = random_travel(9)
    y = robot.rest(travel)
    assert np.abs(robot.moments(y, travel)).max() < 1e-7


def test_stiffness_is_the_slope_of_the_moments_and_moments_that_of_the_energy():
    robot = robot_of(three_tendons(0, sag=0.03), three_tendons(1))
    robot.load_mm[:] = 1e-3, -5e-4, 2e-3
    travel = random_travel(6)
    y = np.random.default_rng(4).standard_normal((len(travel), 4))
    stiffness, moments = robot.stiffness_matrix(y, travel), robot.moments(y, travel)
    for way, step in enumerate(1e-6 * np.eye(4)):
        slope = (robot.moments(y + step, travel) - robot.moments(y - step, travel)) / 2e-6
        assert stiffness[:, way] == pytest.approx(slope, abs=1e-4)
        slope = (robot.energy(y + step, travel)[0] - robot.energy(y - step, travel)[0]) / 2e-6
        assert moments[:, way] == pytest.approx(slope, abs=1e-6)


def rubbing(robot: TendonRobot, friction_per_mm: float = 0.02) -> TendonRobot:
    return replace(robot, friction_per_mm=np.full(len(robot.slack_mm), friction_per_mm))


def test_with_dry_friction_too_stiffness_is_the_slope_of_the_moments():
    robot = rubbing(robot_of(three_tendons(0, sag=0.03), three_tendons(1)))
    rng = np.random.default_rng(2)
    y, travel = rng.uniform(-1.0, 1.0, (20, 4)), random_travel(6, 20)
    anchor = robot.route_mm(y) + rng.uniform(-0.05, 0.05, (20, 6))
    stiffness = robot.stiffness_matrix(y, travel, anchor)
    moments = robot.moments(y, travel, anchor)
    for column, step in enumerate(1e-6 * np.eye(4)):
        ahead, behind = (robot.energy(y + sign * step, travel, anchor) for sign in (1, -1))
        assert stiffness[..., column] == pytest.approx((ahead[1] - behind[1]) / 2e-6, abs=1e-3)
        assert moments[..., column] == pytest.approx((ahead[0] - behind[0]) / 2e-6, abs=1e-6)


def test_dry_friction_holds_a_slack_robot_until_its_moment_is_exceeded():
    """Each of n tendons that run straight holds its force at its lever, whichever way it slides."""
    robot, loose = rubbing(robot_of(three_tendons(0))), np.full((1, 3), -9.0)
    levers_mm = np.abs(robot.levers_mm(np.zeros(2)))
    for axis in range(2):
        most_rad = 0.02 * levers_mm[:, axis].sum()
        for bent_rad, left_rad in ((0.5 * most_rad, 0.5 * most_rad), (2.0 * most_rad, most_rad)):
            y = bent_rad * np.eye(2)[axis][None]
            left = robot.rest(loose, y, anchor_mm=robot.route_mm(y))[0]
            assert left[axis] == pytest.approx(left_rad, abs=0.01)


def test_rests_in_turn_are_those_of_one_after_another():
    robot, travel = rubbing(robot_of(three_tendons(0), three_tendons(1))), random_travel(6, 12)
    travel[5:8] = travel[4] + np.array([[0.01], [0.02], [-0.01]])
    found, anchors = robot.rests_in_turn(travel)
    y = robot.rest(travel[:1])
    anchor = robot.route_mm(y)
    for row in range(12):
        assert anchors[row] == pytest.approx(anchor[0], abs=1e-4)
        y = robot.rest(travel[row : row + 1], y, anchor_mm=anchor)
        anchor = robot.dragged_mm(y, anchor)
        assert found[row] == pytest.approx(y[0], abs=1e-4)


def test_what_is_common_to_the_tendons_of_a_segment_is_pretension_and_bends_nothing():
    robot = robot_of(three_tendons(0), three_tendons(1))
    travel = 2.0 + 0.3 * random_travel(6)
    more = travel + np.repeat([1.0, 2.5], 3)
    assert robot.rest(more) == pytest.approx(robot.rest(travel), abs=1e-6)


def test_taut_tendons_without_load_are_linear_least_squares():
    robot = robot_of(three_tendons(0), three_tendons(1))
    travel = 5.0 + 0.3 * random_travel(6)
    routes = np.tensordot(robot.lever_mm, robot.freedom, axes=((1, 2), (1, 2)))
    weighted = routes.T * robot.tendon_stiffness_mm2
    stiffness = np.diag(np.repeat(robot.stiffness, 2))
    linear = np.linalg.solve(weighted @ routes + stiffness, weighted @ travel.T).T
    assert robot.rest(travel) == pytest.approx(linear, abs=1e-9)


def test_slack_tendons_never_push():
    robot = robot_of(three_tendons(0))
    pulled = np.array([[3.0, -2.0, -2.0], [3.0, -10.0, -10.0]])
    y = robot.rest(pulled)
    assert y[0] == pytest.approx(y[1])
    assert y[1, 0] > 0.3
    assert robot.rest(np.full((1, 3), -2.0)) == pytest.approx(np.zeros((1, 2)), abs=1e-9)


def test_a_tendon_of_the_second_segment_alone_bends_both_alike():
    robot = robot_of(three_tendons(0), three_tendons(1))
    bend = robot.bend_rad(robot.rest(np.array([[-9.0, -9.0, -9.0, 4.0, -9.0, -9.0]])))[0]
    assert bend[0] == pytest.approx(bend[1])
    assert np.degrees(np.arctan2(bend[0, 1], bend[0, 0])) == pytest.approx(30.0)


def test_a_soft_segment_bends_more_under_the_same_tendon():
    robot = robot_of(three_tendons(0), three_tendons(1, stiffness=0.5))
    bend = robot.bend_rad(robot.rest(np.array([[-9.0, -9.0, -9.0, 4.0, -9.0, -9.0]])))[0]
    assert np.linalg.norm(bend[1]) == pytest.approx(2.0 * np.linalg.norm(bend[0]))


def test_the_papers_robot_is_one_description_of_it():
    paper = Robot()
    # Each motor winds a pair; the tendons of segment 2 pass segment 1 on its neutral axis.
    segments = tuple(
        Segment(
            length_mm=length,
            tendon_radius_mm=paper.tendon_radius_mm,
            bends="plane",
            direction_deg=direction,
            compliance=STIFF,
            tendons=(
                Tendon(angle_deg=direction, motor=motor),
                Tendon(angle_deg=direction + 180.0, motor=motor, winding=-1),
            ),
        )
        for motor, direction, length in zip(
            (1, 2), (90.0, 0.0), paper.segment_lengths_mm, strict=True
        )
    )
    q = np.random.default_rng(5).uniform(-1.0, 1.0, (50, 2))
    model = ChainModel(segments, paper.pulley_radius_mm * q)
    score = model.nothing
    for number, unknown in enumerate(model.unknowns):
        if unknown.kind == "dead_travel":
            score[number] = -unknown.mean / unknown.deviation
    bend = model.bend_rad(score, np.arange(len(q)))
    offset = np.array([0.0, paper.marker_offset_mm, 0.0])
    at_tip = Weights(np.array([0.0, 1.0]), np.zeros(2), offset)
    tip, _ = point_mm(np.array(paper.segment_lengths_mm), bend, at_tip, np.zeros(2))
    expected = ConstantCurvature(paper).tip_mm(q)
    assert (tip - offset) @ PAPER_FRAME.T == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("load_per_mm", [(3e-3, -2e-3, 4e-3), (-4e-3, 0.0, 2e-3)])
def test_weight_bends_the_halves_of_a_segment_as_if_each_were_one(load_per_mm):
    robot = robot_of(three_tendons(0), three_tendons(1))
    robot.load_mm[:] = load_per_mm
    halved = replace(
        robot,
        lengths_mm=np.repeat(0.5 * robot.lengths_mm, 2),
        freedom=np.eye(8).reshape(8, 4, 2),
        stiffness=np.repeat(2.0 * robot.stiffness, 2),
        lever_mm=np.repeat(robot.lever_mm, 2, axis=1),
        sag_mm=np.repeat(2.0 * robot.sag_mm, 2, axis=1),
        shorter_mm=np.repeat(2.0 * robot.shorter_mm, 2),
        weights=Weights(
            np.insert(robot.weights.at_end, [0, 1], 0.0),
            np.repeat(0.5 * robot.weights.along, 2),
            robot.weights.tip_offset_mm,
        ),
    )
    travel = 0.3 * random_travel(6, rows=10)
    found, true = robot.halves_rad(robot.rest(travel)), halved.bend_rad(halved.rest(travel))
    uneven, true_uneven = (halves[:, ::2] - halves[:, 1::2] for halves in (found, true))
    assert np.abs(true_uneven).max() > 0.03
    # What is left is of second order in the weight.
    assert uneven == pytest.approx(true_uneven, abs=0.15 * np.abs(true_uneven).max())


def test_a_bent_chain_that_sags_is_shorter_as_one_of_hinges_is():
    hinges, bend = 5, np.array([1.2, -0.7])
    sag = 60.0 / (8.0 * hinges**2 * 4.5)
    robot = robot_of(three_tendons(0, sag=sag))
    pieces = np.tile(bend / hinges, (hinges, 1))
    # Each hinge is in the middle of a rigid piece.
    frame, end = np.eye(3), np.zeros(3)
    for piece in pieces:
        half = np.array([0.0, 0.0, 0.5 * 60.0 / hinges])
        end = end + frame @ half
        frame = frame @ Rotation.from_rotvec([-piece[1], piece[0], 0.0]).as_matrix()
        end = end + frame @ half
    place, _ = robot.ends_mm(bend)[0]
    assert place[:, 0] == pytest.approx(end, abs=0.03)


def test_weight_to_one_side_bends_the_robot_that_way():
    robot = robot_of(three_tendons(0), three_tendons(1))
    robot.load_mm[0] = -1e-3
    loose = np.full((1, 6), -9.0)
    bend = robot.bend_rad(robot.rest(loose))[0]
    assert bend[0, 0] > bend[1, 0] > 0.0
    assert bend[:, 1] == pytest.approx([0.0, 0.0], abs=1e-9)
