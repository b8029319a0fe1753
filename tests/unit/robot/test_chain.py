"""Chains of any number of segments against independent constructions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from scipy.integrate import trapezoid

from ccr_host.description.schema import Robot
from ccr_host.robot.chain import PAPER_FRAME, Weights, bend_of, ends_mm, point_mm
from ccr_host.robot.kinematics import ConstantCurvature

ROBOTS = 250


def random_chain(segments: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lengths, bending vectors of many robots, and an offset; some segments are straight."""
    random = np.random.default_rng(segments)
    size = random.choice([0.0, 1e-9, 1e-4, 0.02, 1.0, 4.0], (ROBOTS, segments, 1))
    bends = size * random.standard_normal((ROBOTS, segments, 2))
    return random.uniform(5, 300, segments), bends, random.uniform(-20, 20, 3)


def tip_mm(lengths: np.ndarray, bends: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, ...]:
    at_tip = np.arange(1, len(lengths) + 1) == len(lengths)
    weights = Weights(1.0 * at_tip, 0.0 * at_tip, offset)
    return point_mm(lengths, bends, weights, np.zeros(len(lengths)))


def by_transforms(lengths: np.ndarray, bends: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """The tip by homogeneous transforms: each segment is a screw motion of constant twist."""
    pose = np.broadcast_to(np.eye(4), (len(bends), 4, 4))
    for length, bend in zip(lengths, np.moveaxis(bends, 1, 0), strict=True):
        twist = np.zeros((len(bends), 4, 4))
        twist[:, 0, 2], twist[:, 1, 2] = bend.T
        twist[:, 2, 0], twist[:, 2, 1] = -bend.T
        twist[:, 2, 3] = length
        pose = pose @ scipy.linalg.expm(twist)
    return (pose @ np.append(offset, 1.0))[:, :3]


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_tip_of_random_robots_is_that_of_homogeneous_transforms(segments):
    lengths, bends, offset = random_chain(segments)
    expected = pytest.approx(by_transforms(lengths, bends, offset), abs=1e-10 * lengths.sum())
    assert tip_mm(lengths, bends, offset)[0] == expected
    place, turn = ends_mm(lengths, bends, np.zeros(segments))[-1]
    assert (place + turn @ offset[:, None])[..., 0] == expected


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_derivatives_of_random_robots_are_those_of_finite_differences(segments):
    lengths, bends, offset = random_chain(segments)
    weights = Weights(np.arange(1.0, segments + 1.0), np.full(segments, 0.5), offset)
    shorter = np.linspace(1.0, 3.0, segments)
    _, by = point_mm(lengths, bends, weights, shorter)
    step = 1e-5
    for segment in range(segments):
        for axis in (0, 1):
            aside = np.zeros((segments, 2))
            aside[segment, axis] = step
            ahead, _ = point_mm(lengths, bends + aside, weights, shorter)
            behind, _ = point_mm(lengths, bends - aside, weights, shorter)
            slope = (ahead - behind) / (2 * step)
            assert by[:, segment, axis] == pytest.approx(slope, abs=1e-6 * lengths.sum())


def test_for_the_papers_robot_tip_and_jacobian_are_those_of_its_equations_to_rounding():
    robot = Robot()
    paper = ConstantCurvature(robot)
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (200, 2))
    q[:20] *= 1e-7
    theta = paper.bending_rad(q)
    bends = np.zeros((len(q), 2, 2))
    bends[:, 0, 1], bends[:, 1, 0] = theta.T
    offset = np.array([0.0, robot.marker_offset_mm, 0.0])
    tip, by = tip_mm(np.array(robot.segment_lengths_mm), bends, offset)
    assert (tip - offset) @ PAPER_FRAME.T == pytest.approx(paper.tip_mm(q), abs=1e-11)
    gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    by_motors = gain * np.stack([by[:, 0, 1], by[:, 1, 0]], axis=1) @ PAPER_FRAME.T
    assert np.swapaxes(by_motors, 1, 2) == pytest.approx(paper.jacobian_mm_rad(q), abs=1e-10)


def test_a_segment_bends_towards_its_bending_vector_by_its_length():
    shape = bend_of([0.6, 0.8])
    assert shape.turn[:, 2] == pytest.approx([0.6 * np.sin(1), 0.8 * np.sin(1), np.cos(1)])
    assert shape.turn @ shape.turn.T == pytest.approx(np.eye(3))


def test_points_along_a_segment_are_added_up_at_their_mean():
    bends = np.array([[0.7, -0.4], [-0.3, 0.5]])
    lengths = np.array([50.0, 40.0])
    shares = np.linspace(0.0, 1.0, 2001)
    first = [bend_of(share * bends[0]).end * share * lengths[0] for share in shares]
    second = [bend_of(share * bends[1]).end * share * lengths[1] for share in shares]
    mean = trapezoid(first, shares, axis=0)
    mean_2 = first[-1] + bend_of(bends[0]).turn @ trapezoid(second, shares, axis=0)
    nowhere = np.zeros(2)
    found, _ = point_mm(
        lengths, bends, Weights(nowhere, np.array([2.0, 3.0]), np.zeros(3)), nowhere
    )
    assert found == pytest.approx(2.0 * mean + 3.0 * mean_2, rel=2e-4)
