"""Tracker `aruco:N`: ArUco or AprilTag markers under webcam N, through OpenCV.

The frame is OpenCV's: x to the right, y down, z away from the camera, mm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.core.plugins import import_optional
from ccr_host.tracking.sources.camera_model import CameraModel
from ccr_host.tracking.sources.reopened import ReopenedCamera
from ccr_host.tracking.tracker import Pose, TrackerHealth

Image = NDArray[np.uint8]

DEFAULT_LATENCY_US = 60_000
"""Estimated time from the middle of an exposure to its image in the host: two frames at 30 Hz."""
_PIXEL_CENTRE_PX = 0.5
"""That refinement counts from a pixel's corner, the rest of OpenCV from its centre."""
_MOST_OFF_PX = 0.5
"""RMS error of the coordinates of a tag's corners, if they are those of a square in its pose. It is
0.2 at most on whole tags with edges of 60 to 120 px (bench/rendered_tags.py). A partly covered tag
is read as well, up to 15 mm off: its error is 0.4 to 1.5."""
_BLUR_PX, _LEAST_CONTRAST = 0.8, 30
"""Blur before edges are sought, and the least difference of the greys beside one. Rendered
tags are found with a difference of 50, and noise with a deviation of 10 is passed over."""
_POLL_NS = 1
"""A time-out of 0 would make OpenCV wait forever."""


@dataclass(frozen=True)
class ArucoSettings:
    """The tags on the robot, and how they are detected."""

    tag_size_mm: float
    """Edge of the black square."""
    dictionary: str = "DICT_APRILTAG_36h11"
    """Name of the OpenCV dictionary."""
    tags: Mapping[int, str] = field(default_factory=lambda: tag_names(("M1", "M2", "M3")))
    """Names by tag number."""


def tag_names(markers: Sequence[str]) -> dict[int, str]:
    """Markers by tag number: 0 is the base, 1 the tip, which f of (10) needs; then the others."""
    first, *between, last = markers
    return dict(enumerate((first, last, *between)))


class ImageSource(Protocol):
    """A camera that is read without waiting; `TrackerError` means that it is lost."""

    def newest_image(self) -> Image | None:
        """The image that has arrived since the last call, if any."""

    def close(self) -> None:
        """Close the camera."""


class TagDetector:
    """Detects tags and their poses in an image.

    Raises:
        ConfigError: OpenCV is not installed, or it has no such dictionary.
    """

    def __init__(self, model: CameraModel, settings: ArucoSettings) -> None:
        self._cv2 = cv2 = _opencv()
        self._calibrated = model
        self._model = model
        self._size_px: tuple[int, int] | None = None
        self._settings = settings
        number = getattr(cv2.aruco, settings.dictionary, None)
        if number is None:
            raise ConfigError(
                f"dictionary {settings.dictionary}: not known to OpenCV",
                "use e.g. DICT_APRILTAG_36h11 or DICT_4X4_50",
            )
        parameters = cv2.aruco.DetectorParameters()
        # Fits lines to the whole edges: on rendered tags ten times better in depth than SUBPIX.
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        # By default it seeks edges in the sensor's noise, for half a second an image.
        parameters.aprilTagQuadSigma = _BLUR_PX
        parameters.aprilTagMinWhiteBlackDiff = _LEAST_CONTRAST
        self._detector = cv2.aruco.ArucoDetector(
            cv2.aruco.getPredefinedDictionary(number), parameters
        )
        half = settings.tag_size_mm / 2
        # From the top left corner clockwise, as the detector lists them.
        self._corners_mm = np.array(
            [(-half, half, 0), (half, half, 0), (half, -half, 0), (-half, -half, 0)]
        )

    def poses(self, image: Image) -> dict[str, Pose]:
        """The poses of known tags by name; a tag that appears twice counts as not seen.

        Raises:
            ConfigError: the calibration does not fit such images.
        """
        height_px, width_px = image.shape[:2]
        if self._size_px != (width_px, height_px):
            self._model = self._calibrated.of_images(width_px, height_px)
            self._size_px = width_px, height_px
        corners, numbers, _ = self._detector.detectMarkers(image)
        if numbers is None:
            return {}
        found = [int(number) for number in np.ravel(numbers)]
        poses = {}
        for number, corner in zip(found, corners, strict=True):
            name = self._settings.tags.get(number)
            if name is not None and found.count(number) == 1:
                pose = self._pose(np.reshape(corner, (4, 2)) - _PIXEL_CENTRE_PX)
                if pose is not None:
                    poses[name] = pose
        return poses

    def _pose(self, corners_px: Array) -> Pose | None:
        cv2, model = self._cv2, self._model
        # The likelier one of two poses comes first.
        _, rotations, positions_mm, off_px = cv2.solvePnPGeneric(
            self._corners_mm,
            corners_px,
            model.matrix,
            model.distortion,
            flags=cv2.SOLVEPNP_IPPE_SQUARE,
        )
        if not len(positions_mm) or not np.ravel(off_px)[0] <= _MOST_OFF_PX:
            return None
        turn = scipy.spatial.transform.Rotation.from_rotvec(np.ravel(rotations[0]))
        return Pose.of(np.ravel(positions_mm[0]).astype(np.float64), turn)


class ArucoTracker(ReopenedCamera[ImageSource]):
    """Tags under a camera; each image with at least one known tag is a frame.

    ``latency_us`` is the time from the middle of an exposure to its image.
    """

    def __init__(
        self,
        name: str,
        open_camera: Callable[[], ImageSource],
        detector: TagDetector,
        latency_us: int = DEFAULT_LATENCY_US,
    ) -> None:
        super().__init__(name, open_camera)
        self._detector = detector
        self._latency_us = latency_us
        self._images = 0

    @property
    def health(self) -> TrackerHealth:
        tracking = self._connection is not None and self._frames.count > 0
        state = "stopped" if not self._running else ("tracking" if tracking else "looking for tags")
        return TrackerHealth(
            state=state,
            tracking=tracking,
            rate_hz=self._frames.rate_hz,
            frames=self._frames.count,
            lost_frames=self._images - self._frames.count,
            reconnections=self._reconnections,
            last_error=self._last_error,
        )

    def _process(self, connection: ImageSource, time_us: int) -> None:
        image = connection.newest_image()
        if image is None:
            return
        self._images += 1
        try:
            poses = self._detector.poses(image)
        except ConfigError as error:
            self._last_error = f"{self.name}: {error}"
            if self._frames.count:  # during a run the robot is made safe as for any lost marker
                return
            self._running = False
            raise ConfigError(f"{self.name}: {error.cause}", error.cure) from None
        if poses:
            self._frames.add_poses(time_us - self._latency_us, poses)


class Webcam:
    """A camera of the operating system, read only when an image is available (Linux, V4L2).

    Raises:
        TrackerError: there is no such camera.
    """

    def __init__(self, number: int) -> None:
        self._cv2 = _opencv()
        self._number = number
        self._capture: Any = self._cv2.VideoCapture(number, self._cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise TrackerError(f"aruco:{number}: no such camera", "plug it in; see ls /dev/video*")
        self._capture.set(self._cv2.CAP_PROP_BUFFERSIZE, 1)  # older images are useless

    def newest_image(self) -> Image | None:
        ready, _ = self._cv2.VideoCapture.waitAny([self._capture], timeoutNs=_POLL_NS)
        if not ready:
            return None
        taken, image = self._capture.retrieve()
        if not taken:
            raise TrackerError(f"aruco:{self._number}: the camera is gone", "check its cable")
        pixels: Image = image
        return pixels

    def close(self) -> None:
        self._capture.release()


def _opencv() -> Any:  # noqa: ANN401 - OpenCV has no types
    return import_optional("cv2", "aruco", "tracker aruco:")
