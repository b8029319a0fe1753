"""How frames become samples."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.tracking.markers.marker_tracker import MarkerTracker
from ccr_host.tracking.tracker import MarkerFrame, Pose, TrackerHealth

FRAME_US = 50_000
TURN = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


class Camera:
    """Shows what a test tells it to."""

    name = "test:"

    def __init__(self) -> None:
        self.frame = None
        self.health = TrackerHealth(state="tracking", tracking=True)

    def newest_frame(self):
        return self.frame

    def show(self, number, points_mm=(), tools=None, out_of_volume=None) -> None:
        points = np.asarray(points_mm, dtype=float).reshape(-1, 3)
        outside = np.zeros(len(points), dtype=bool) if out_of_volume is None else out_of_volume
        self.frame = MarkerFrame(number * FRAME_US, number, points, outside, tools or {})


@pytest.fixture(scope="module")
def rest_mm() -> np.ndarray:
    robot = TwinRobot(Twin())
    robot.advance_to(100_000)
    return robot.markers_mm()


@pytest.fixture
def camera() -> Camera:
    return Camera()


def tracker_of(camera: Camera, camera_to_robot=TURN) -> MarkerTracker:
    return MarkerTracker(camera, Robot(), camera_to_robot, lambda: np.zeros(2))


def play(camera, tracker, frames, **shown) -> None:
    for number in frames:
        camera.show(number, **shown)
        tracker.advance_to(camera.frame.exposed_us + 45_000)


def test_spheres_are_told_apart_and_turned_into_the_robots_frame(camera, rest_mm) -> None:
    tracker = tracker_of(camera)
    in_camera = rest_mm @ TURN + (10.0, 20.0, -900.0)
    play(camera, tracker, range(1, 20), points_mm=in_camera[[2, 0, 1]])
    assert tracker.newest().exposed_us == 19 * FRAME_US
    np.testing.assert_allclose(tracker.newest().tip_mm, rest_mm[2] - rest_mm[0], atol=1e-6)
    assert tracker.lost == ()
    assert tracker.trouble() == ""


def test_without_registration_samples_stay_in_the_cameras_frame(camera, rest_mm) -> None:
    tracker = tracker_of(camera, None)
    in_camera = rest_mm @ TURN + (10.0, 20.0, -900.0)
    play(camera, tracker, range(1, 40), points_mm=in_camera)
    np.testing.assert_allclose(tracker.newest().markers_mm, in_camera, atol=1e-6)


def test_points_out_of_the_volume_are_not_used_and_told(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    play(camera, tracker, range(1, 20), points_mm=rest_mm, out_of_volume=np.ones(3, dtype=bool))
    assert tracker.newest() is None
    assert "3 of them outside the camera's volume" in tracker.trouble()


def test_a_frame_without_tip_leaves_the_older_sample(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    play(camera, tracker, range(1, 20), points_mm=rest_mm)
    play(camera, tracker, range(20, 23), points_mm=rest_mm[:2])
    assert tracker.newest().exposed_us == 19 * FRAME_US
    assert "M3" in tracker.lost
    assert "lacks" in tracker.trouble()
    assert "register" not in tracker.trouble()


def test_points_that_follow_no_motor_are_asked_for_a_registration(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    play(camera, tracker, range(1, 20), points_mm=rest_mm)
    play(camera, tracker, range(20, 30), points_mm=rest_mm + np.outer([0, 1, 2], [30, 0, 0]))
    assert "M1" not in tracker.lost
    assert "how the camera stands: register" in tracker.trouble()


def test_named_bodies_are_the_markers_and_m2_may_be_absent(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    poses = {name: Pose(rest_mm[i], UNTURNED) for i, name in ((0, "M1"), (2, "M3"))}
    play(camera, tracker, [1], tools=poses)
    np.testing.assert_allclose(tracker.newest().tip_mm, rest_mm[2] - rest_mm[0])
    assert np.isnan(tracker.newest().markers_mm[1]).all()


def test_spheres_of_a_hidden_body_are_never_taken_for_markers(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    poses = {name: Pose(rest_mm[i], UNTURNED) for i, name in enumerate(("M1", "M2", "M3"))}
    play(camera, tracker, [1], tools=poses)
    play(camera, tracker, range(2, 30), points_mm=rest_mm)
    assert tracker.newest().exposed_us == FRAME_US


def test_a_frame_that_is_older_or_the_same_is_not_taken_again(camera, rest_mm) -> None:
    tracker = tracker_of(camera, np.eye(3))
    play(camera, tracker, range(1, 20), points_mm=rest_mm)
    newest = tracker.newest()
    play(camera, tracker, [5, 19], points_mm=rest_mm + 3.0)
    assert tracker.newest() is newest
