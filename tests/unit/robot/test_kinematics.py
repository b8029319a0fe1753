"""The constant-curvature model against independent constructions of the same robot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.any_robot import random_robot
from ccr_host.description.schema import Robot
from ccr_host.robot.arc import arc_at, doubled
from ccr_host.robot.kinematics import ConstantCurvature
from tests.unit.robot.random_robots import chain_of_transforms, levers_of

PAPER = ConstantCurvature(Robot())
GAIN = 12.5 / 4.5
angles = st.floats(-1.5, 1.5)
geometries = st.builds(
    Robot,
    segment_lengths_mm=st.tuples(st.floats(5, 200), st.floats(5, 200)),
    tendon_radius_mm=st.floats(1, 20),
    marker_offset_mm=st.floats(0, 60),
    pulley_radius_mm=st.floats(1, 20),
)


def by_a_chain_of_transforms(geometry: Robot, q_rad: np.ndarray) -> np.ndarray:
    """M3 - M1 from many short rigid links, each bent by its share, midpoint rule."""
    links = 4000
    theta = np.asarray(q_rad) * geometry.pulley_radius_mm / geometry.tendon_radius_mm
    pose = np.eye(4)
    for segment, length in enumerate(geometry.segment_lengths_mm):
        bend = theta[segment] / links
        cosine, sine = np.cos(bend / 2), np.sin(bend / 2)
        half = np.eye(4)
        if segment == 0:
            half[1:3, 1:3] = [[cosine, sine], [-sine, cosine]]
        else:
            half[0:2, 0:2] = [[cosine, -sine], [sine, cosine]]
        slide = np.eye(4)
        slide[1, 3] = -length / links
        link = half @ slide @ half
        pose = pose @ np.linalg.matrix_power(link, links)
    marker = np.array([0.0, 0.0, geometry.marker_offset_mm, 1.0])
    # M3 stands on the disk where segment 1 ends, displaced along segment 2 only: (9) leaves out
    # the turn of the tip about segment 2, which does not move a marker on its axis z2.
    return (pose @ marker - marker)[:3]


@settings(max_examples=40, deadline=None)
@given(geometry=geometries, first=angles, second=angles)
def test_tip_is_marker_3_minus_marker_1_of_a_chain_of_rigid_links(geometry, first, second):
    scale = geometry.tendon_radius_mm / geometry.pulley_radius_mm
    q = np.array([first, second]) * scale * 2.0
    chain = by_a_chain_of_transforms(geometry, q)
    length = sum(geometry.segment_lengths_mm)
    assert ConstantCurvature(geometry).tip_mm(q) == pytest.approx(chain, abs=1e-6 * length)


def test_straight_robot_points_along_minus_y():
    assert PAPER.tip_mm([0.0, 0.0]) == pytest.approx([0.0, -102.0, 0.0], abs=1e-12)


def test_one_motor_radian_bends_2_78_rad():
    assert PAPER.bending_rad([1.0, -1.0]) == pytest.approx([12.5 / 4.5, -12.5 / 4.5])


def test_matches_equation_10_as_printed_away_from_zero():
    q = np.array([0.4, -0.7])
    (l1, l2), d1 = PAPER.lengths_mm, 15.0
    k1, k2 = PAPER.bending_rad(q) / np.array([l1, l2])
    t1, t2 = k1 * l1, k2 * l2
    printed = [
        (1 - np.cos(t2)) / k2,
        -(1 / k1 - d1) * np.sin(t1) - np.sin(t2) * np.cos(t1) / k2,
        (1 / k1 - d1) * (1 - np.cos(t1)) + np.sin(t2) * np.sin(t1) / k2,
    ]
    assert PAPER.tip_mm(q) == pytest.approx(printed, rel=1e-12)


@settings(max_examples=200, deadline=None)
@given(theta=st.one_of(st.floats(-7, 7), st.floats(-1e-3, 1e-3), st.floats(0.99, 1.01)))
def test_arc_and_three_derivatives_match_gauss_quadrature_of_the_tangent(theta):
    nodes, weights = np.polynomial.legendre.leggauss(40)
    share = (nodes + 1) / 2
    for arc in (arc_at(theta), doubled(arc_at(0.5 * theta))):
        for order, value in enumerate(arc.derivatives):
            integrand = (1j * share) ** order * np.exp(1j * theta * share)
            assert value == pytest.approx(np.sum(weights / 2 * integrand), abs=2e-14)
        assert arc.turn == pytest.approx(np.exp(1j * theta), abs=2e-15)


@pytest.mark.parametrize("theta", [0.0, 5e-324, 1e-300, 1e-17, 1e-9, 1e-4])
def test_straight_segment_is_an_ordinary_point(theta):
    q = np.array([theta, -theta])
    linear = PAPER.tip_mm([0, 0]) + PAPER.jacobian_mm_rad([0, 0]) @ q
    assert PAPER.tip_mm(q) == pytest.approx(linear, abs=200 * theta**2 * 8 + 1e-13)
    assert PAPER.jacobian_mm_rad(q) == pytest.approx(
        PAPER.jacobian_mm_rad([0, 0]), abs=2000 * theta + 1e-12
    )


@settings(max_examples=100, deadline=None)
@given(geometry=geometries, first=angles, second=angles)
def test_derivatives_match_central_differences(geometry, first, second):
    model = ConstantCurvature(geometry)
    scale = geometry.tendon_radius_mm / geometry.pulley_radius_mm
    q = np.array([first, second]) * 2.78 * scale
    step = 1e-5 * scale
    for motor in (0, 1):
        ahead, behind = q + step * np.eye(2)[motor], q - step * np.eye(2)[motor]
        slope = (model.tip_mm(ahead) - model.tip_mm(behind)) / (2 * step)
        bend = (model.jacobian_mm_rad(ahead) - model.jacobian_mm_rad(behind)) / (2 * step)
        size = sum(geometry.segment_lengths_mm) + geometry.marker_offset_mm
        assert model.jacobian_mm_rad(q)[:, motor] == pytest.approx(slope, abs=1e-8 * size / scale)
        assert model.second_order(q)[2][..., motor] == pytest.approx(
            bend, abs=1e-8 * size / scale**2
        )


def test_single_pose_and_array_of_poses_agree():
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (3, 5, 2))
    tips = PAPER.tip_mm(q)
    assert tips.shape == (3, 5, 3)
    assert PAPER.jacobian_mm_rad(q).shape == (3, 5, 3, 2)
    assert PAPER.second_order(q)[2].shape == (3, 5, 3, 2, 2)
    for index in np.ndindex(3, 5):
        assert PAPER.tip_mm(q[index]) == pytest.approx(tips[index], abs=1e-12)


def test_lateral_map_folds_at_133_6_deg_of_bending():
    def lateral_rank_loss(theta_deg):
        q = np.array([0.3, np.radians(theta_deg) / GAIN])
        return np.linalg.det(PAPER.jacobian_mm_rad(q)[[0, 2]])

    assert lateral_rank_loss(133.0) * lateral_rank_loss(134.0) < 0
    assert abs(lateral_rank_loss(133.5634)) < 1e-3 * abs(lateral_rank_loss(0.0))


def test_full_jacobian_keeps_its_rank_at_the_fold():
    fold = np.radians(133.5634) / GAIN
    poses = np.stack([np.linspace(-1.4, 1.4, 50), np.full(50, fold)], axis=-1)
    assert np.linalg.svd(PAPER.jacobian_mm_rad(poses), compute_uv=False)[:, 1].min() > 20.0


@settings(max_examples=40, deadline=None)
@given(first=angles, second=angles)
def test_backbone_has_the_length_of_the_robot_and_ends_under_the_tip_marker(first, second):
    line = PAPER.backbone_mm([first, second], points=2041)
    assert line[0] == pytest.approx([0, 0, -15.0])
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.sum() == pytest.approx(102.0, rel=1e-5)
    theta_1 = PAPER.bending_rad([first, second])[0]
    disk_axis = np.array([0.0, np.sin(theta_1), np.cos(theta_1)])
    assert line[-1] + 15.0 * disk_axis == pytest.approx(PAPER.tip_mm([first, second]), abs=1e-9)


def test_arc_of_an_array_equals_arc_of_its_elements():
    theta = np.array([[-4.0, -1.0, -0.3], [0.0, 0.999, 6.0]])
    whole = arc_at(theta).derivatives
    for index, value in np.ndenumerate(theta):
        for order, single in enumerate(arc_at(float(value)).derivatives):
            assert whole[order][index] == pytest.approx(single, abs=1e-15)


@pytest.mark.long
@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_random_robots_are_chains_of_homogeneous_transforms_and_their_derivatives(segments):
    rng = np.random.default_rng(segments)
    for _ in range(250):
        robot = random_robot(rng, segments)
        model = ConstantCurvature(robot)
        length = sum(model.lengths_mm) + robot.marker_offset_mm
        # Derivatives in units of the motors' effect on the bending.
        scale = np.abs(model.bending_rad(np.eye(model.motors))).sum(axis=1).max()
        q = rng.choice([1e-9, 0.1, 1.0]) * rng.uniform(-1.5, 1.5, model.motors) / scale
        tip, jacobian, hessian = model.second_order(q)
        assert tip == pytest.approx(chain_of_transforms(robot, q), abs=1e-12 * length)
        aside = rng.normal(size=model.motors) / model.motors / scale
        step = 1e-5
        ahead, behind = model.second_order(q + step * aside), model.second_order(q - step * aside)
        slope, bend = ((a - b) / (2 * step) for a, b in zip(ahead[:2], behind[:2], strict=True))
        assert jacobian @ aside == pytest.approx(slope, abs=1e-8 * length)
        assert hessian @ aside == pytest.approx(bend, abs=1e-8 * length * scale)


def test_bending_of_random_robots_is_what_their_tendons_ask_for():
    rng = np.random.default_rng(5)
    for number in range(200):
        robot = random_robot(rng, 1 + number % 4)
        model = ConstantCurvature(robot)
        levers, wound = levers_of(robot)
        slack = levers @ model.bending_rad(np.eye(model.motors)).T - wound
        # Only what the tendons of a segment have in common, its pretension, bends nothing.
        assert levers.T @ slack == pytest.approx(np.zeros_like(levers.T @ slack), abs=1e-9)


def test_the_papers_robot_described_by_segments_is_the_papers_robot():
    described = ConstantCurvature(Robot(segments=Robot().chain))
    q = np.random.default_rng(6).uniform(-1.5, 1.5, (20, 2))
    assert np.array_equal(described.tip_mm(q), PAPER.tip_mm(q))
    assert described.bending_rad(q) == pytest.approx(q * GAIN, rel=1e-14)
