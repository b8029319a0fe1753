"""Tags in rendered images of a known scene."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.tracking.sources.aruco import (
    ArucoSettings,
    ArucoTracker,
    TagDetector,
)
from ccr_host.tracking.sources.camera_model import CameraModel, load_camera_file
from tests.exposer import running

TAG_MM = 20.0
CELLS = 10
"""Edge of an AprilTag 36h11 with a white margin, in cells; the tag itself takes 8."""
PIXELS_PER_CELL = 20
SIZE = (960, 1280)
MATRIX = np.array([(1400.0, 0, 640), (0, 1400, 480), (0, 0, 1)])
DISTORTION = np.array([-0.12, 0.05, 0.001, -0.001, 0.0])
FACING = Rotation.from_rotvec((np.pi, 0, 0))
BASE = (FACING * Rotation.from_rotvec((0.1, 0.05, 0.1)), np.array((-30.0, -25.0, 300.0)))
TIP = (
    FACING * Rotation.from_rotvec((0.4, -0.3, 0.6)),
    np.array((45.0, 30.0, 320.0)),
)


def render(tags: dict, distortion=DISTORTION) -> np.ndarray:
    """Image of tags, (rotation, position) by number, on grey, under a distorting camera."""
    image = np.full(SIZE, 128, np.uint8)
    v, u = np.mgrid[0 : SIZE[0], 0 : SIZE[1]].astype(np.float64)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None]
    rays = cv2.undistortPoints(pixels, MATRIX, distortion).reshape(-1, 2)
    rays = np.column_stack([rays, np.ones(len(rays))])
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    edge = CELLS * PIXELS_PER_CELL
    for number, (rotation, position_mm) in tags.items():
        texture = np.full((edge, edge), 255, np.uint8)
        inner = slice(PIXELS_PER_CELL, edge - PIXELS_PER_CELL)
        texture[inner, inner] = cv2.aruco.generateImageMarker(
            dictionary, number, 8 * PIXELS_PER_CELL
        )
        normal = rotation.apply((0, 0, 1))
        depth = (normal @ position_mm) / (rays @ normal)
        local_mm = rotation.inv().apply(rays * depth[:, None] - position_mm)
        scale = 8 * PIXELS_PER_CELL / TAG_MM
        x = (local_mm[:, 0] * scale + edge / 2 - 0.5).reshape(SIZE).astype(np.float32)
        y = (edge / 2 - 0.5 - local_mm[:, 1] * scale).reshape(SIZE).astype(np.float32)
        inside = (x >= 0) & (y >= 0) & (x < edge - 1) & (y < edge - 1)
        warped = cv2.remap(texture, x, y, cv2.INTER_LINEAR)
        image[inside] = warped[inside]
    return cv2.GaussianBlur(image, (3, 3), 0.7)


@pytest.fixture(scope="module")
def scene():
    return render({0: BASE, 1: TIP})


@pytest.fixture(scope="module")
def detector():
    return TagDetector(CameraModel(MATRIX, DISTORTION), ArucoSettings(TAG_MM))


@pytest.mark.long
def test_two_tags_are_found_where_they_are(scene, detector):
    poses = detector.poses(scene)
    assert set(poses) == {"M1", "M3"}
    for name, (rotation, position_mm) in {"M1": BASE, "M3": TIP}.items():
        error_mm = np.abs(poses[name].position_mm - position_mm)
        assert (error_mm < (0.05, 0.05, 0.3)).all()
        w, x, y, z = poses[name].quaternion
        turned = Rotation.from_quat((x, y, z, w)) * rotation.inv()
        assert np.degrees(turned.magnitude()) < 3


def test_distortion_of_the_camera_matters(scene):
    naive = TagDetector(CameraModel(MATRIX, np.zeros(5)), ArucoSettings(TAG_MM))
    error_mm = np.linalg.norm(naive.poses(scene)["M3"].position_mm - TIP[1])
    assert error_mm > 0.5


def test_tags_nobody_asked_for_and_empty_images_give_nothing(detector):
    assert detector.poses(render({7: BASE})) == {}
    assert detector.poses(np.full(SIZE, 128, np.uint8)) == {}


@pytest.mark.long
def test_tag_that_appears_twice_counts_as_not_seen(detector):
    image = render({0: BASE, 1: TIP})
    image = np.maximum(np.roll(image, (0, 450), axis=(0, 1)) * 0, image)
    image[:300, 900:] = image[300:600, 400:780].max()
    patch = image[250:500, 380:630].copy()
    image[650:900, 50:300] = patch
    assert "M1" not in detector.poses(image)


@pytest.mark.parametrize("aside_mm", [(-12.0, 20.0), (-6.0, 20.0), (12.0, 19.0)])
def test_a_tag_of_which_an_edge_is_covered_is_not_seen_in_another_place(detector, aside_mm):
    """It is read as well, but 5 or 6 mm off, as the covering tag's edge is taken for its own."""
    place_mm = np.array((0.0, 0.0, 300.0))
    before_mm = place_mm + np.array((*aside_mm, -20.0))
    tilted = FACING * Rotation.from_rotvec((0.25, 0.2, 0.0))
    poses = detector.poses(render({0: (tilted, place_mm), 1: (tilted, before_mm)}))
    assert set(poses) == {"M3"}


@pytest.mark.parametrize("noise_grey", [2.0, 10.0])
def test_tags_are_found_under_the_sensors_noise(scene, detector, noise_grey):
    noise = noise_grey * np.random.default_rng(1).standard_normal(scene.shape)
    poses = detector.poses((scene + noise).clip(0, 255).astype(np.uint8))
    for name, (_, position_mm) in zip(("M1", "M3"), (BASE, TIP), strict=True):
        assert np.linalg.norm(poses[name].position_mm - position_mm) < 0.5


class Images:
    """A camera that shows what the test puts in front of it."""

    def __init__(self, *images) -> None:
        self.images = list(images)
        self.closed = False

    def newest_image(self):
        image = self.images.pop(0) if self.images else None
        if isinstance(image, Exception):
            raise image
        return image

    def close(self) -> None:
        self.closed = True


def test_each_image_with_a_tag_is_a_frame(scene, detector):
    blank = np.full(SIZE, 128, np.uint8)
    source = Images(scene, None, blank, scene)
    tracker = ArucoTracker("aruco:0", lambda: source, detector, latency_us=60_000)
    times_us = []
    with running(tracker):
        for time_us in range(100_000, 500_000, 50_000):
            tracker.advance_to(time_us)
            if tracker.newest_frame() is not None:
                times_us.append(tracker.newest_frame().exposed_us)
    assert sorted(set(times_us)) == [40_000, 190_000]
    assert tracker.health.frames == 2
    assert tracker.health.lost_frames == 1
    assert source.closed


def test_camera_that_is_lost_is_opened_again(scene, detector):
    first, second = Images(scene, TrackerError("gone", "plug in")), Images(scene)
    cameras = [first, second]
    tracker = ArucoTracker("aruco:0", lambda: cameras.pop(0), detector)
    tracker.start()
    for time_us in range(0, 2_000_000, 50_000):
        tracker.advance_to(time_us)
    assert first.closed
    assert tracker.health.frames == 2
    assert tracker.health.reconnections == 1
    assert "gone" in tracker.health.last_error


@pytest.mark.parametrize("ending", ["yaml", "xml", "json"])
def test_camera_file_gives_the_calibration_back(tmp_path, ending):
    path = tmp_path / f"camera.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", DISTORTION)
    storage.release()
    model = load_camera_file(path)
    np.testing.assert_array_equal(model.matrix, MATRIX)
    np.testing.assert_array_equal(model.distortion, DISTORTION)


def test_camera_file_of_ros_is_read(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(
        "image_width: 640\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [600.5, 0, 320, 0, 6.0e2,\n    240, 0, 0, 1]\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, -2.0e-1, 0, 0, .5]\n"
    )
    model = load_camera_file(path)
    assert model.matrix.tolist() == [[600.5, 0, 320], [0, 600, 240], [0, 0, 1]]
    assert model.distortion.tolist() == [0.1, -0.2, 0, 0, 0.5]


def opencv_file(tmp_path, matrix=MATRIX, distortion=DISTORTION, suffix=".yml", **scalars):
    path = tmp_path / f"camera{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in scalars.items():
        storage.write(name, value)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", np.asarray(distortion, dtype=float).reshape(-1, 1))
    storage.release()
    return path


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_every_number_of_coefficients_that_opencv_has_is_read_and_used(
    tmp_path, scene, suffix, count
):
    distortion = np.zeros(count)
    distortion[:4] = DISTORTION[:4]
    size = {"image_width": 1280, "image_height": 960}
    model = load_camera_file(opencv_file(tmp_path, distortion=distortion, suffix=suffix, **size))
    assert model.size_px == (1280, 960)
    np.testing.assert_array_equal(model.distortion, distortion)
    poses = TagDetector(model, ArucoSettings(TAG_MM)).poses(scene)
    assert np.linalg.norm(poses["M3"].position_mm - TIP[1]) < 0.4


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"distortion": (0.1, 0.2, 0.3)}, "3 distortion_coefficients.*4, 5, 8, 12 or 14"),
        ({"distortion": np.zeros(6)}, "6 distortion_coefficients"),
        ({"matrix": np.zeros((3, 3))}, "never calibrated"),
        ({"matrix": np.eye(4)}, "camera_matrix"),
        ({"fisheye_model": 1}, "fisheye"),
        ({"distortion_model": "equidistant"}, "equidistant"),
    ],
)
def test_calibration_that_cannot_be_used_is_refused_with_its_reason(tmp_path, change, told):
    with pytest.raises(ConfigError, match=told):
        load_camera_file(opencv_file(tmp_path, **change))


@pytest.mark.parametrize("factor", [0.5, 0.75, 2])
def test_calibration_is_scaled_to_images_of_the_same_shape(scene, factor):
    model = CameraModel(MATRIX, DISTORTION, (1280, 960))
    detector = TagDetector(model, ArucoSettings(TAG_MM))
    size = (round(1280 * factor), round(960 * factor))
    image = cv2.resize(
        scene, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    )
    tip = detector.poses(image)["M3"].position_mm
    assert np.linalg.norm(tip - TIP[1]) < 1.0
    assert np.linalg.norm(detector.poses(scene)["M3"].position_mm - TIP[1]) < 0.4


@pytest.mark.parametrize(
    ("size_px", "told"),
    [((1280, 720), "640 x 480 pixels.*1280 x 720.*aspect"), (None, "optical axis")],
)
def test_calibration_of_other_images_ends_it_before_the_first_frame(scene, size_px, told):
    image = cv2.resize(scene, (640, 480))
    detector = TagDetector(CameraModel(MATRIX, DISTORTION, size_px), ArucoSettings(TAG_MM))
    tracker = ArucoTracker("aruco:0", lambda: Images(image), detector)
    with running(tracker), pytest.raises(ConfigError, match=f"aruco:0.*{told}"):
        tracker.advance_to(0)
    tracker.advance_to(50_000)


def test_camera_that_changes_the_shape_of_its_images_in_mid_run_is_lost_and_says_why(scene):
    cropped = np.ascontiguousarray(scene[:720])
    model = CameraModel(MATRIX, DISTORTION, (1280, 960))
    detector = TagDetector(model, ArucoSettings(TAG_MM))
    tracker = ArucoTracker("aruco:0", lambda: Images(scene, cropped, cropped), detector)
    with running(tracker):
        for time_us in (0, 50_000, 100_000):
            tracker.advance_to(time_us)
        assert tracker.health.frames == 1
        assert "aspect ratio" in tracker.health.last_error


@pytest.mark.parametrize("text", ["", "nonsense", "%YAML:1.0\n---\nfocal: 3\n"])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="camera_matrix"):
        load_camera_file(path)
    with pytest.raises(ConfigError, match="No such file"):
        load_camera_file(tmp_path / "missing.yaml")


def test_unknown_dictionary_is_refused():
    with pytest.raises(ConfigError, match="DICT_NONE"):
        TagDetector(CameraModel(MATRIX, DISTORTION), ArucoSettings(TAG_MM, dictionary="DICT_NONE"))
