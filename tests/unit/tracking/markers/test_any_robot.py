"""Markers of robots of one to four segments, planar or spatial, whose motion is known."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.any_robot import random_robot
from ccr_host.core.errors import TrackerError
from ccr_host.description import schema
from ccr_host.description.robot import Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.tracking.markers.check import MarkerCheck, seen_lengths_mm
from ccr_host.tracking.markers.labelling import Labeller
from ccr_host.tracking.tracker import Sample

FRAME_US = 50_000
NOISE_MM = 0.15
GLUE_MM = 0.4
FRAMES, CLEAR = 90, 50
SEGMENTS = st.integers(1, 4)
SEEDS = st.integers(0, 10_000)


def drawn(seed: int, segments: int) -> tuple[np.random.Generator, Robot]:
    """A robot whose markers are told apart by the lengths of its segments."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, segments)
    lengths_mm = rng.permutation(np.linspace(40, 90, segments) + rng.uniform(-4, 4, segments))
    chain = tuple(
        part.model_copy(update={"length_mm": float(length)})
        for part, length in zip(robot.chain, lengths_mm, strict=True)
    )
    # Servos that turn by 85 deg then bend no segment by more than a circle.
    pulley_mm = 2.0 * min(part.tendon_radius_mm for part in chain)
    kept = {"segments": chain, "marker_offset_mm": 15.0, "pulley_radius_mm": pulley_mm}
    return rng, robot.model_copy(update=kept)


def moving(rng: np.random.Generator, robot: Robot, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Motor angles, (frames, n), and markers, (frames, S + 1, 3), of a slow motion."""
    model = ConstantCurvature(robot)
    freedoms = model.bending_rad(np.zeros(model.motors)).size
    most_rad = rng.uniform(-0.8, 0.8, freedoms)
    q_rad = np.linalg.pinv(model.bending_rad(np.eye(model.motors)).T) @ most_rad
    share = np.sin(np.linspace(0.0, 1.5, frames))[:, None]
    sag_rad = rng.normal(0.0, 0.1, freedoms)
    places, _ = model.markers_mm(share * most_rad + sag_rad)
    glue_mm = rng.normal(0.0, GLUE_MM, (1, places.shape[1] + 1, 3))
    return share * q_rad, np.pad(places, ((0, 0), (1, 0), (0, 0))) + glue_mm


@pytest.mark.long
@settings(max_examples=6, deadline=None)
@given(seed=SEEDS, segments=SEGMENTS, registered=st.booleans())
def test_markers_are_told_apart_or_lost_but_never_confused(seed, segments, registered) -> None:
    rng, robot = drawn(seed, segments)
    q_rad, markers_mm = moving(rng, robot, FRAMES)
    to_robot = Rotation.random(random_state=seed).as_matrix()
    in_camera = markers_mm @ to_robot + (10.0, 20.0, -900.0)
    labeller = Labeller(robot, to_robot if registered else None)
    for frame, true_mm in enumerate(in_camera):
        is_clear = frame < CLEAR
        seen = np.ones(len(true_mm), dtype=bool) if is_clear else rng.random(len(true_mm)) > 0.1
        points = true_mm[seen] + rng.normal(0.0, NOISE_MM, (seen.sum(), 3))
        if not is_clear:
            points = np.vstack([points, true_mm.mean(axis=0) + rng.uniform(-100, 100, (2, 3))])
        found = labeller.label(frame * FRAME_US, rng.permutation(points), q_rad[frame])
        known = np.isfinite(found[:, 0])
        off_mm = np.linalg.norm(found - true_mm, axis=1)
        assert (off_mm[known] < 2.0).all()
        if frame == CLEAR - 1 and registered:
            assert known.all()


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, segments=SEGMENTS)
def test_named_markers_of_a_robot_that_moves_are_accepted(seed, segments) -> None:
    rng, robot = drawn(seed, segments)
    _, markers_mm = moving(rng, robot, 60)
    check = MarkerCheck(schema.Description(robot=robot))
    for frame, seen_mm in enumerate(markers_mm):
        noise_mm = rng.normal(0.0, NOISE_MM, seen_mm.shape)
        assert check.accepts(Sample(frame * FRAME_US, seen_mm + noise_mm))
        check.robot_moves()


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, segments=SEGMENTS)
def test_two_exchanged_names_are_told_at_rest(seed, segments) -> None:
    _, robot = drawn(seed, segments)
    places, _ = ConstantCurvature(robot).markers_mm(np.full((1, 2 * segments), 0.05))
    markers_mm = np.vstack([np.zeros(3), places[0]])
    for first, second in combinations(range(segments + 1), 2):
        order = np.arange(segments + 1)
        order[[first, second]] = second, first
        cause, _ = MarkerCheck(schema.Description(robot=robot)).trouble(markers_mm[order])
        assert f"M{first + 1} and M{second + 1} are exchanged" in cause


@pytest.mark.long
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, segments=st.integers(2, 4))
def test_two_markers_that_change_places_end_a_run(seed, segments) -> None:
    rng, robot = drawn(seed, segments)
    _, markers_mm = moving(rng, robot, 30)
    check = MarkerCheck(schema.Description(robot=robot))
    check.robot_moves()
    assert check.accepts(Sample(0, markers_mm[0]))
    first, second = sorted(rng.choice(segments + 1, 2, replace=False).tolist())
    order = np.arange(segments + 1)
    order[[first, second]] = second, first
    told = f"M{first + 1} and M{second + 1} (have changed places|are exchanged)"
    with pytest.raises(TrackerError, match=told):
        for frame, seen_mm in enumerate(markers_mm[1:, order], 1):
            assert not check.accepts(Sample(frame * FRAME_US, seen_mm))


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, segments=SEGMENTS)
def test_lengths_are_seen_from_anywhere_while_the_last_segment_is_straight(seed, segments) -> None:
    rng, robot = drawn(seed, segments)
    model = ConstantCurvature(robot)
    bending_rad = rng.uniform(-0.6, 0.6, model.bending_rad(np.zeros(model.motors)).size)
    bending_rad[model.segment_of_freedom == segments - 1] = 0.0
    places, _ = model.markers_mm(bending_rad[None])
    turn = Rotation.random(random_state=seed)
    markers_mm = turn.apply(np.vstack([np.zeros(3), places[0]])) + 50.0
    seen = seen_lengths_mm(markers_mm, robot)
    np.testing.assert_allclose(seen, model.lengths_mm, atol=1e-6)
