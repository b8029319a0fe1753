"""Calibration of a camera: a pinhole with OpenCV's distortion, and the files that hold it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import printable, read_text

DISTORTION_COUNTS = (4, 5, 8, 12, 14)
"""Numbers of coefficients that OpenCV's models have."""
_CURE = "calibrate the camera, see docs/trackers.md"
_FILE_BYTES = 1_000_000
_MATRIX_NUMBERS = 9
_MOST_PIXELS = 100_000
_DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")
"""ROS's names of OpenCV's models."""
_OFF_CENTRE = 0.25
"""Fraction of the image by which the optical axis may be off its centre, if its size is unknown."""
_FOCAL_LENGTHS = (0.1, 100.0)
"""Limits of the focal length in widths of the image: 157 deg of view, and 0.6 deg."""
_PIXEL_ASPECTS = (0.5, 2.0)
_ASPECT_TOLERANCE = 0.005
"""Tolerance for rounding to whole pixels."""
_TOKEN = r"[-+.\w]"
_NUMBERS = rf"((?:[\s,\[\]]|-(?=\s)|{_TOKEN}++(?![\"\s]*:))*+)"
"""Lists in brackets, nested or not, of dashes, or of spaces, up to the next key."""


@dataclass(frozen=True, eq=False)
class CameraModel:
    """Pinhole model with distortion, as calibrated by OpenCV."""

    matrix: Array
    """(3, 3), pixels."""
    distortion: Array
    """(k,): OpenCV's coefficients, k one of `DISTORTION_COUNTS`."""
    size_px: tuple[int, int] | None = None
    """Width and height of the calibration images; None if the file does not state them."""

    def of_images(self, width_px: int, height_px: int) -> CameraModel:
        """The model scaled to smaller or larger images of the same view.

        Raises:
            ConfigError: the calibrated camera can make such images only by cropping, or not at all.
        """
        delivered = f"the camera delivers {width_px} x {height_px} pixels"
        if self.size_px is None:
            shares = self.matrix[:2, 2] / (width_px, height_px)
            if np.max(np.abs(shares - 0.5)) > _OFF_CENTRE:
                raise ConfigError(
                    f"{delivered}, but the optical axis of the calibration is at "
                    f"({self.matrix[0, 2]:.0f}, {self.matrix[1, 2]:.0f})",
                    "calibrate the camera with images of that size",
                )
            return self
        by_width, by_height = width_px / self.size_px[0], height_px / self.size_px[1]
        if abs(by_width / by_height - 1) > _ASPECT_TOLERANCE:
            raise ConfigError(
                f"{delivered}, its calibration is of {self.size_px[0]} x {self.size_px[1]}, "
                "which is another aspect ratio",
                "calibrate the camera with images of the size that it delivers",
            )
        scaling = np.diag([by_width, by_height, 1.0])
        # Pixels are counted from their centres, the image begins half a pixel before the first.
        scaling[:2, 2] = (scaling[[0, 1], [0, 1]] - 1) / 2
        return CameraModel(scaling @ self.matrix, self.distortion, (width_px, height_px))

    def implausible(self) -> str:
        """Why no camera is like this, one line; empty if one may be."""
        focal_px, axis_px = self.matrix[[0, 1], [0, 1]], self.matrix[:2, 2]
        if min(focal_px) <= 0:
            return "its camera_matrix has no focal lengths: the camera was never calibrated"
        if not _pinhole(self.matrix):
            return "its camera_matrix is not fx, 0, cx, 0, fy, cy, 0, 0, 1, row by row"
        size_px = np.array(self.size_px or 2 * axis_px, dtype=np.float64)
        if not (axis_px > 0).all() or not (axis_px < size_px).all():
            return f"its optical axis at ({axis_px[0]:.3g}, {axis_px[1]:.3g}) is outside the image"
        shortest, longest = np.array(_FOCAL_LENGTHS) * size_px[0]
        narrowest, widest = _PIXEL_ASPECTS
        if not shortest <= focal_px[0] <= longest or not (
            narrowest <= focal_px[1] / focal_px[0] <= widest
        ):
            return (
                f"focal lengths of {focal_px[0]:.3g} and {focal_px[1]:.3g} pixels with an image "
                f"{size_px[0]:.0f} pixels wide: no camera has them"
            )
        if self._greatest_distortion(axis_px / focal_px) > 1:
            return "its distortion moves the edges of the image by more than half the image"
        return ""

    def _greatest_distortion(self, edge: Array) -> float:
        """Shift of a point at `edge` (x, y at depth 1), as a fraction of its distance."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, *_ = np.pad(self.distortion, (0, 12))
        square = float(edge @ edge)
        powers = square ** np.arange(1, 4)
        with np.errstate(all="ignore"):
            radial = (1 + (k1, k2, k3) @ powers) / (1 + (k4, k5, k6) @ powers) - 1
            others = np.abs((p1, p2)).sum() * 3 * square + np.abs((s1, s3)).sum() * square
            others += np.abs((s2, s4)).sum() * square**2
            greatest = abs(radial) + others / np.sqrt(square)
        return float(np.nan_to_num(greatest, nan=np.inf))


def load_camera_file(path: Path) -> CameraModel:
    """Read the file that OpenCV's calibration writes (YAML, XML or JSON), or ROS's (YAML).

    Raises:
        ConfigError: no such file, or no usable calibration in it; says why.
    """
    text, _ = read_text(path, "camera file", _CURE, _FILE_BYTES)
    text = re.sub(r"^\s*#.*", "", text, flags=re.MULTILINE)

    def refuse(why: str) -> NoReturn:
        raise ConfigError(f"camera file {path}: {why}", _CURE)

    matrix = _numbers_of("camera_matrix", text, refuse)
    distortion = _numbers_of("distortion_coefficients", text, refuse)
    if len(matrix) != _MATRIX_NUMBERS:
        refuse(f"{len(matrix)} numbers in its camera_matrix, which is 3 x 3")
    if len(distortion) not in DISTORTION_COUNTS:
        *most, last = map(str, DISTORTION_COUNTS)
        refuse(
            f"{len(distortion)} distortion_coefficients, OpenCV's model has "
            f"{', '.join(most)} or {last} of them: k1, k2, p1, p2, k3, ..."
        )
    name = (
        "fisheye" if _word_of("fisheye_model", text) == "1" else _word_of("distortion_model", text)
    )
    if name not in ("", *_DISTORTION_MODELS):
        refuse(f"distortion_model {name}; {' and '.join(_DISTORTION_MODELS)} can be used")
    model = CameraModel(matrix.reshape(3, 3), distortion, _size(text, refuse))
    if why := model.implausible():
        refuse(why)
    return model


def _pinhole(matrix: Array) -> bool:
    others = matrix.copy()
    others[[0, 1, 0, 1], [0, 1, 2, 2]] = 0
    return bool((others == np.diag((0, 0, 1))).all())


def _size(text: str, refuse: Callable[[str], NoReturn]) -> tuple[int, int] | None:
    """Width and height of the images; None if not both are stated."""
    words = {side: _word_of(f"image_{side}", text) for side in ("width", "height")}
    sizes = []
    for side, word in words.items():
        if not word:
            return None
        whole = re.fullmatch(r"(\d{1,6})(?:\.0*)?", word, re.ASCII)
        if whole is None or not 0 < int(whole[1]) <= _MOST_PIXELS:
            refuse(f"image_{side} = {printable(word, at_most=20)}, which is no number of pixels")
        sizes.append(int(whole[1]))
    return sizes[0], sizes[1]


def _numbers_of(name: str, text: str, refuse: Callable[[str], NoReturn]) -> Array:
    """The data of a matrix.

    OpenCV's own reader crashes the process on deeply nested files.
    """
    form = rf"(?<!/)\b{name}\b(?:[\"\s:]*(?=\[)|[\s\S]{{1,300}}?\bdata\b[\"\s:>]*){_NUMBERS}"
    found = {
        tuple(re.findall(rf"{_TOKEN}*\w{_TOKEN}*", one)) for one in re.findall(form, text, re.I)
    }
    if not found:
        refuse(f"no {name} in it, as OpenCV or ROS write it")
    if len(found) > 1:
        refuse(f"{len(found)} different {name}: give the file of one camera")
    (words,) = found
    numbers = []
    for word in words:
        try:
            numbers.append(float(re.sub(r"\.(inf|nan)", r"\1", word, flags=re.I)))
        except ValueError:
            refuse(f"{printable(word, at_most=20)} in its {name}, which is no number")
        if not np.isfinite(numbers[-1]):
            refuse(f"{word} in its {name}, which is not finite")
    return np.array(numbers)


def _word_of(name: str, text: str) -> str:
    """The value of a key; empty if it is absent."""
    found = re.search(rf"\b{name}\b[\" :>]*({_TOKEN}+)", text, re.IGNORECASE)
    return "" if found is None else found[1]
