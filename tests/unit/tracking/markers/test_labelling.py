import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench.labelling import FRAME_US
from ccr_host.description.schema import Robot
from ccr_host.tracking.markers.labelling import BASE_MEMORY_US, Labeller

ALL = ("M1", "M2", "M3")
PROVEN = 12


def lost(found) -> tuple[str, ...]:
    return tuple(name for name, at in zip(ALL, found, strict=True) if np.isnan(at[0]))


def sees_tip(found) -> bool:
    """Whether the tip is known relative to M1."""
    return not {"M1", "M3"} & {*lost(found)}


@pytest.mark.long
@pytest.mark.parametrize("view", ["camera", "unregistered_camera"])
def test_three_markers_at_rest_are_told_apart_within_a_second(view, rest, rest_q, request):
    found = request.getfixturevalue(view).show_again(rest, PROVEN, q_rad=rest_q)
    assert lost(found) == ()
    np.testing.assert_allclose(found, rest, atol=0.8)


@pytest.mark.long
def test_a_single_frame_is_never_enough(camera, rest, rest_q):
    assert lost(camera.show(rest, q_rad=rest_q)) == ALL


def test_no_points_give_no_markers(camera):
    found = camera.show_again(np.zeros((3, 3)), 3, hidden=(0, 1, 2))
    assert lost(found) == ALL
    assert not sees_tip(found)


def test_a_hidden_tip_is_lost_at_once_and_found_again(camera, rest, rest_q):
    camera.show_again(rest, PROVEN, q_rad=rest_q)
    hidden = camera.show(rest, q_rad=rest_q, hidden=(2,))
    assert lost(hidden) == ("M3",)
    assert not sees_tip(hidden)
    assert lost(camera.show_again(rest, 2, q_rad=rest_q)) == ()


@pytest.mark.parametrize("away_mm", [4.0, 8.0, 20.0])
def test_a_phantom_beside_a_hidden_tip_is_not_taken_for_it(camera, rest, rest_q, away_mm):
    camera.show_again(rest, PROVEN, q_rad=rest_q)
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        phantom = rest[2] + away_mm * direction
        assert not sees_tip(camera.show(rest, q_rad=rest_q, hidden=(2,), extra=phantom))
        camera.show_again(rest, 3, q_rad=rest_q)


def test_the_base_is_remembered_for_a_while(camera, rest, rest_q):
    camera.show_again(rest, PROVEN, q_rad=rest_q)
    frames = BASE_MEMORY_US // FRAME_US
    found = camera.show_again(rest, frames, q_rad=rest_q, hidden=(0,))
    assert sees_tip(found)
    assert not sees_tip(camera.show(rest, q_rad=rest_q, hidden=(0,)))


def test_a_base_that_was_knocked_gives_no_tip_until_it_is_found_again(camera, rest, rest_q):
    camera.show_again(rest, PROVEN, q_rad=rest_q)
    moved = rest + np.array([3.0, 0.0, 0.0])
    frames = BASE_MEMORY_US // FRAME_US + 20
    shown = np.array([camera.show(moved, q_rad=rest_q) for _ in range(frames)])
    off_mm = np.linalg.norm(shown[:, 2] - shown[:, 0] - (rest[2] - rest[0]), axis=1)
    assert not (off_mm >= 2.0).any()
    assert sees_tip(shown[-1])


def test_a_robot_pushed_far_while_hidden_is_found_again(camera, slow_motion, rest, rest_q):
    camera.show_again(rest, PROVEN, q_rad=rest_q)
    camera.show_again(rest, 5, q_rad=rest_q, hidden=(1, 2))
    elsewhere = slow_motion.markers_mm[300]
    assert np.linalg.norm(elsewhere[2] - rest[2]) > 20.0
    found = camera.show_again(elsewhere, 15, q_rad=slow_motion.q_rad[300])
    assert lost(found) == ()
    np.testing.assert_allclose(found, elsewhere, atol=0.8)


def test_motor_angles_that_are_wrong_by_20_deg_do_no_harm(camera, rest, rest_q):
    found = camera.show_again(rest, PROVEN, q_rad=rest_q + np.radians([20.0, -20.0]))
    assert lost(found) == ()
    np.testing.assert_allclose(found, rest, atol=0.8)


def test_three_spheres_that_are_no_robot_are_never_labelled(camera, rest, rest_q):
    stretched = rest * np.array([1.0, 1.6, 1.0])
    assert lost(camera.show_again(stretched, 40, q_rad=rest_q)) == ALL


def test_time_that_goes_back_is_refused(camera, rest):
    camera.show(rest)
    with pytest.raises(ValueError, match="after one at"):
        camera.labeller.label(FRAME_US, rest, (0.0, 0.0))


@settings(max_examples=20, deadline=None)
@given(
    frames=st.lists(
        hnp.arrays(float, st.tuples(st.integers(0, 12), st.just(3)), elements=st.floats(-500, 500)),
        min_size=1,
        max_size=8,
    )
)
def test_every_label_is_a_point_of_the_frame(frames):
    labeller = Labeller(Robot(), np.eye(3))
    for number, points in enumerate(frames):
        found = labeller.label((number + 1) * FRAME_US, points, (0.0, 0.0))
        for marker in found[1:]:
            assert np.isnan(marker).all() or (points == marker).all(axis=1).any()
