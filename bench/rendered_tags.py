"""Tags on the twin under a rendered webcam, read by the detector of `aruco:`.

python -m bench.rendered_tags    # time of a detection, and error of each tag
ccr-host track ellipse --set tracker.noise_mm=1 --tracker bench/rendered_tags.py:RenderedTags

The camera looks across the robot's first bending plane, from 300 mm. Tags face it, tilted a little,
and cover each other where the robot bends far.
"""

from __future__ import annotations

import time
from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import ccr_host
from ccr_host.description import schema
from ccr_host.tracking.sources.aruco import DEFAULT_LATENCY_US, ArucoSettings, TagDetector
from ccr_host.tracking.sources.camera_model import CameraModel

Array = NDArray[np.float64]

PERIOD_US = 100_000
SIZE_PX = (1280, 960)
FOCAL_PX = 1800.0
DISTANCE_MM = 300.0
TAG_MM = 10.0
NOISE_GREY = 2.0
"""Standard deviation of a pixel, of 255; assumed."""
_MATRIX = np.array([(FOCAL_PX, 0.0, 639.5), (0.0, FOCAL_PX, 479.5), (0.0, 0.0, 1.0)])
_CELL_PX = 24
_EDGE_PX = 10 * _CELL_PX
"""Edge of a tag's texture: 8 cells and a white margin."""
_FINER = 3
"""Rendered that much finer than the image, whose pixels are means."""
_HALF_MM = 0.5 * 10 / 8 * TAG_MM
_CORNERS_MM = _HALF_MM * np.array([(-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)])
_ACROSS = Rotation.from_matrix([(0, 0, -1), (0, -1, 0), (-1, 0, 0)])
_TO_CAMERA = Rotation.from_rotvec((0.02, -0.05, 0.1)) * _ACROSS
_FACING = Rotation.from_rotvec((np.pi, 0, 0)) * Rotation.from_rotvec((0.25, 0.2, 0.0))
_NUMBERS = (0, 2, 1)
"""Numbers of the tags at M1, M2 and M3."""


class RenderedTags:
    """Ten images per second of tags at the twin's markers."""

    def __init__(self, _description: ccr_host.Description) -> None:
        self.next_exposure_us = 0
        self.image = np.zeros(SIZE_PX[::-1], np.uint8)
        self._rng = np.random.default_rng(1)
        self.detector = TagDetector(
            CameraModel(_MATRIX, np.zeros(5), SIZE_PX), ArucoSettings(TAG_MM)
        )
        self._textures = [_texture(number) for number in _NUMBERS]
        self._origin_mm: Array | None = None
        self._in_flight: deque[ccr_host.MarkerFrame] = deque()
        self._newest: ccr_host.MarkerFrame | None = None

    def start(self) -> None:
        """Nothing to open."""

    def stop(self) -> None:
        """Nothing to close."""

    def places_mm(self, markers_mm: Array) -> Array:
        """The markers in the camera's frame."""
        if self._origin_mm is None:
            middle_mm = _TO_CAMERA.apply(markers_mm[0] + (0.0, -50.0, 0.0))
            self._origin_mm = np.array((0.0, 0.0, DISTANCE_MM)) - middle_mm
        places: Array = _TO_CAMERA.apply(markers_mm) + self._origin_mm
        return places

    def render(self, markers_mm: Array) -> None:
        """Take the image."""
        image = np.full(SIZE_PX[::-1], 120.0, np.float32)
        places = self.places_mm(markers_mm)
        for marker in np.argsort(-places[:, 2]):  # The nearest one last.
            _paint(image, self._textures[marker], places[marker])
        noise = self._rng.standard_normal(image.shape, dtype=np.float32)
        image = cv2.GaussianBlur(image, (3, 3), 0.7) + NOISE_GREY * noise
        self.image = image.clip(0, 255).astype(np.uint8)

    def expose(self, time_us: int, markers_mm: Array) -> None:
        self.next_exposure_us = time_us + PERIOD_US
        self.render(markers_mm)
        poses = self.detector.poses(self.image)
        if poses:
            nothing = np.empty((0, 3)), np.empty(0, dtype=bool)
            number = time_us // PERIOD_US
            self._in_flight.append(ccr_host.MarkerFrame(time_us, number, *nothing, poses))

    def advance_to(self, time_us: int) -> None:
        while self._in_flight and self._in_flight[0].exposed_us + DEFAULT_LATENCY_US <= time_us:
            self._newest = self._in_flight.popleft()

    def newest_frame(self) -> ccr_host.MarkerFrame | None:
        return self._newest


def _texture(number: int) -> NDArray[np.uint8]:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    texture = np.full((_EDGE_PX, _EDGE_PX), 255, np.uint8)
    inner = slice(_CELL_PX, -_CELL_PX)
    texture[inner, inner] = cv2.aruco.generateImageMarker(dictionary, number, 8 * _CELL_PX)
    return texture


def _paint(image: NDArray[np.float32], texture: NDArray[np.uint8], place_mm: Array) -> None:
    """Draw a tag over what is there."""
    pixels = (_FACING.apply(_CORNERS_MM) + place_mm) @ _MATRIX.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, SIZE_PX)
    size = tuple((high - low).tolist())
    if min(size) <= 0:
        return
    ends = -0.5, _EDGE_PX - 0.5
    flat = np.array([(ends[i], ends[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    finer = np.diag((_FINER, _FINER, 1.0))
    finer[:2, 2] = 0.5 * (_FINER - 1)
    warp = finer @ cv2.getPerspectiveTransform(flat, (pixels - low).astype(np.float32))

    def drawn(source: NDArray[np.uint8]) -> NDArray[np.float32]:
        large = cv2.warpPerspective(source, warp, (_FINER * size[0], _FINER * size[1]))
        return cv2.resize(large, size, interpolation=cv2.INTER_AREA).astype(np.float32)

    part = image[low[1] : high[1], low[0] : high[0]]
    part *= 1.0 - drawn(np.full_like(texture, 255)) / 255.0
    part += drawn(texture)


def main() -> None:
    """Print the time of a detection and the errors."""
    rng = np.random.default_rng(0)
    straight = np.array([(0.0, 0.0, 15.0), (0.0, -58.5, 15.0), (0.0, -102.0, 15.0)])
    most = np.array([(0.0, 0.0, 0.0), (20.0, -10.0, 15.0), (40.0, -30.0, 30.0)])
    tags = RenderedTags(schema.load())
    times_ms, errors_mm = [], []
    for _ in range(40):
        markers_mm = straight + most * rng.uniform(-1.0, 1.0)
        tags.render(markers_mm)
        begun = time.process_time()
        poses = tags.detector.poses(tags.image)
        times_ms.append(1e3 * (time.process_time() - begun))
        places = dict(zip(("M1", "M2", "M3"), tags.places_mm(markers_mm), strict=True))
        errors_mm.extend(pose.position_mm - places[name] for name, pose in poses.items())
    rms_mm = np.sqrt(np.mean(np.square(errors_mm), axis=0))
    print(f"a detection takes {np.median(times_ms):.0f} ms of CPU (median of {len(times_ms)})")
    print(f"{len(errors_mm)} of {3 * len(times_ms)} tags; error across the view", end=" ")
    print(f"{np.hypot(*rms_mm[:2]):.2f} mm RMS, along it {rms_mm[2]:.2f}")


if __name__ == "__main__":
    main()
