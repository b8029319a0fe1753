import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bench.any_robot import random_robot
from ccr_host.description.schema import Robot
from ccr_host.robot.backbone import (
    fitted_bending_rad,
    marker_feet_mm,
    measured_backbone_mm,
    turns_to,
)
from ccr_host.robot.kinematics import ConstantCurvature

MODEL = ConstantCurvature(Robot())
ANGLE = st.floats(-0.8, 0.8)
"""Motor angles, rad; 2.8 times that is the bending."""


def markers_mm(q_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The model's own backbone, without the module under test."""
    length_1, length_2 = MODEL.lengths_mm
    without_second = Robot().model_copy(update={"segment_lengths_mm": (length_1, 1e-9)})
    only_first = ConstantCurvature(without_second)
    middle = only_first.tip_mm((q_rad[0], 0.0))
    assert length_2 > 0
    return np.stack([np.zeros(3), middle, MODEL.tip_mm(q_rad)])


@pytest.mark.long
@settings(deadline=None)
@given(ANGLE, ANGLE, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))
def test_markers_of_the_model_give_back_its_shape(
    q_1: float, q_2: float, off_1: float, off_2: float
) -> None:
    q_rad = np.array((q_1, q_2))
    seen_mm = markers_mm(q_rad) + np.array((100.0, -50.0, 3.0))
    start_rad = MODEL.bending_rad(q_rad + np.array((off_1, off_2)))
    bending_rad = fitted_bending_rad(MODEL, seen_mm, start_rad)
    np.testing.assert_allclose(bending_rad, MODEL.bending_rad(q_rad), atol=1e-3)
    curve_mm = measured_backbone_mm(MODEL, seen_mm, bending_rad, points=41)
    expected_mm = MODEL.backbone_mm(q_rad, points=2001)
    gaps_mm = np.linalg.norm(curve_mm[:, None] - expected_mm[None], axis=-1).min(axis=1)
    assert gaps_mm.max() < 0.6, "a cubic follows an arc of 2.2 rad to half a millimetre"


@given(st.lists(st.floats(-5, 5), min_size=6, max_size=6), ANGLE, ANGLE)
def test_the_curve_goes_through_what_was_measured_even_where_the_model_does_not_fit(
    disturbance_mm: list[float], q_1: float, q_2: float
) -> None:
    q_rad = np.array((q_1, q_2))
    seen_mm = markers_mm(q_rad)
    seen_mm[1:] += np.reshape(disturbance_mm, (2, 3))
    bending_rad = fitted_bending_rad(MODEL, seen_mm, MODEL.bending_rad(q_rad))
    curve_mm = measured_backbone_mm(MODEL, seen_mm, bending_rad, points=41)
    feet_mm = marker_feet_mm(MODEL, seen_mm, bending_rad)
    np.testing.assert_allclose(curve_mm[[0, 20, 40]], feet_mm, atol=1e-9)
    stalks_mm = np.linalg.norm(seen_mm - feet_mm, axis=1)
    np.testing.assert_allclose(stalks_mm, MODEL.marker_offset_mm, atol=1e-9)


@settings(deadline=None)
@given(st.integers(1, 4), st.integers(0, 2**31))
def test_markers_of_any_robot_give_back_its_shape(segments: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = random_robot(rng, segments)
    model = ConstantCurvature(robot)
    bending_rad = rng.uniform(-0.6, 0.6, model.bending_rad(np.zeros(robot.motors)).shape)
    seen_mm = np.zeros((segments + 1, 3))
    seen_mm[1:] = model.markers_mm(bending_rad[None])[0][0]
    fitted_rad = fitted_bending_rad(model, seen_mm + np.array((7.0, -3.0, 1.0)), bending_rad + 0.05)
    np.testing.assert_allclose(model.markers_mm(fitted_rad[None])[0][0], seen_mm[1:], atol=1e-3)
    curve_mm = measured_backbone_mm(model, seen_mm, fitted_rad, points=41)
    assert curve_mm.shape == (41, 3)
    feet_mm = marker_feet_mm(model, seen_mm, fitted_rad)
    np.testing.assert_allclose(curve_mm[[0, -1]], feet_mm[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(feet_mm[0], (0.0, 0.0, -robot.marker_offset_mm), atol=1e-9)
    steps_mm = np.linalg.norm(np.diff(curve_mm, axis=0), axis=1)
    np.testing.assert_allclose(steps_mm.sum(), sum(model.lengths_mm), rtol=0.01)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_disks_turn_to_face_along_the_backbone(direction: list[float]) -> None:
    length = float(np.linalg.norm(direction))
    assume(length > 1e-3)
    unit = np.array(direction) / length
    ((w, x, y, z),) = turns_to(unit[None])
    turned = np.array(
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    )  # the third column of the rotation matrix
    np.testing.assert_allclose(turned, unit, atol=1e-4)
