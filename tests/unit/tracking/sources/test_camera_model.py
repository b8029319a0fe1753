"""Camera files as people write, edit and damage them."""

import json

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.tracking.sources.camera_model import load_camera_file

MATRIX = (800, 0, 320, 0, 790, 240, 0, 0, 1)
COEFFICIENTS = (0.1, -0.2, 0.001, 0, 0)


def ros_text(matrix=MATRIX, distortion=COEFFICIENTS, width=640, height=480):
    lists = [", ".join(map(str, numbers)) for numbers in (matrix, distortion)]
    return (
        f"image_width: {width}\nimage_height: {height}\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{lists[0]}]\n"
        "distortion_model: plumb_bob\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{lists[1]}]\n"
    )


def in_dashes(text: str) -> str:
    for numbers in (MATRIX, COEFFICIENTS):
        flow = ", ".join(map(str, numbers))
        text = text.replace(f"[{flow}]", "".join(f"\n  - {number}" for number in numbers))
    return text


def nested(data) -> str:
    rows = np.reshape(MATRIX, (3, 3)).tolist()
    size = {"image_width": 640, "image_height": 480}
    return json.dumps(
        size | {"camera_matrix": data(rows), "distortion_coefficients": data([COEFFICIENTS])}
    )


@pytest.mark.parametrize(
    "text",
    [
        ros_text(),
        ros_text().replace("\n", "\r\n"),
        ros_text(width="640.0", height="480."),
        "# camera_matrix: {data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n" + ros_text(),
        ros_text() + ros_text(),
        in_dashes(ros_text()),
        nested(lambda rows: rows),
        nested(lambda rows: {"rows": len(rows), "data": rows}),
    ],
)
def test_the_same_calibration_is_read_from_every_form(tmp_path, text):
    path = tmp_path / "camera"
    path.write_bytes(text.encode())
    model = load_camera_file(path)
    assert model.matrix.ravel().tolist() == list(MATRIX)
    assert model.distortion.tolist() == list(COEFFICIENTS)
    assert model.size_px == (640, 480)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (ros_text(matrix=MATRIX[:8]), "8 numbers in its camera_matrix"),
        (ros_text(matrix=("nan", *MATRIX[1:])), "nan in its camera_matrix.*not finite"),
        (ros_text(matrix=(".Inf", *MATRIX[1:])), "Inf in its camera_matrix.*not finite"),
        (ros_text(matrix=("f", *MATRIX[1:])), "f in its camera_matrix.*no number"),
        (ros_text(distortion=("nan",) * 5), "nan in its distortion_coefficients"),
        (ros_text().split("distortion_model")[0], "no distortion_coefficients"),
        (ros_text() + ros_text(matrix=(700, *MATRIX[1:])), "2 different camera_matrix"),
        (ros_text(matrix=(800, 0, 0, 0, 800, 0, 320, 240, 1)), "row by row"),
        (ros_text(matrix=(-800, *MATRIX[1:])), "never calibrated"),
        (ros_text(matrix=(800, 0, -320, *MATRIX[3:])), "optical axis.*outside the image"),
        (ros_text(width=320, height=240), "optical axis.*outside the image"),
        (ros_text(matrix=(3.6, 0, 320, 0, 3.6, *MATRIX[5:])), "focal lengths of 3.6 and 3.6"),
        (ros_text(matrix=(800, 0, 320, 0, 8, *MATRIX[5:])), "focal lengths of 800 and 8"),
        (ros_text(distortion=(1e300,) * 5), "distortion moves the edges"),
        (ros_text(distortion=(0, 0, 0, 0, 0, -5.6, 0, 0)), "distortion moves the edges"),
        (ros_text(width=0), "image_width = 0"),
        (ros_text(height=-480), "image_height = -480"),
        (ros_text(width="VGA"), "image_width = VGA"),
    ],
)
def test_a_file_that_no_camera_has_is_refused_with_the_reason(tmp_path, text, told):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=told):
        load_camera_file(path)
