"""The tour on the emulated board and the twin."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Description, Servo
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.tools.survey import survey
from ccr_host.tools.survey_fit import Survey
from ccr_host.tools.survey_starts import SurveyError, safe_poses_rad

ASKEW_DEG = (69.0, -40.0, 115.0)


def askew(robot: str | None = None, *overrides: str) -> RunOptions:
    turned = f"tracker.rotation_deg={list(ASKEW_DEG)}"
    overrides = (turned, "control.solver=compiled", *overrides)
    return RunOptions(path="8shape", controller="mpc", robot=robot, overrides=overrides)


def surveyed(options: RunOptions) -> Survey:
    description = options.description()
    with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
        return survey(rig, description, lambda *_: None)


def off_deg(found: Survey) -> np.ndarray:
    truth = Rotation.from_rotvec(ASKEW_DEG, degrees=True)
    return (Rotation.from_matrix(found.camera_to_robot) * truth.inv()).as_rotvec(degrees=True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "zeros_deg"),
    [
        ("dirty", (7.0, -6.0)),
        pytest.param("loose-tendons", (-8.0, 8.0), marks=pytest.mark.slow),
    ],
)
def test_a_robot_with_reversed_servos_off_their_zeros_is_found_as_precisely_as_stated(
    robot: str, zeros_deg: tuple[float, float]
) -> None:
    neutral_us = (1500.0 + np.array(zeros_deg) * 1000.0 / 90.0).round(2)
    servos = (
        f"twin.servo_neutral_us={neutral_us.tolist()}",
        "twin.servo_us_per_90_deg=[-1000,1000]",
        "twin.slack_mm=1.2",
        "twin.servo_drift_deg=0",
    )
    found = surveyed(askew(robot, *servos))
    assert found.reversed_motors == (1,)
    assert np.all(np.abs(off_deg(found)) < 2.0 * found.uncertainty_deg)
    zeros_off_rad = found.neutral_rad - np.radians(zeros_deg)
    assert np.all(np.abs(zeros_off_rad) < 2.0 * found.neutral_deviation_rad)


@pytest.mark.long
def test_a_camera_that_sees_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    options = askew()
    description = options.description()
    with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
        monkeypatch.setattr(rig.tracker, "newest", lambda: None)
        with pytest.raises(SurveyError, match="seen in 0 poses"):
            survey(rig, description, lambda *_: None)


def test_poses_stay_well_inside_the_limits() -> None:
    narrow = Description(servo=Servo(angle_min_deg=(-20.0, -5.0), angle_max_deg=(60.0, 85.0)))
    poses = np.degrees(safe_poses_rad(narrow))
    assert np.max(np.abs(poses[:, 0])) == pytest.approx(12.0)
    assert np.max(np.abs(poses[:, 1])) == pytest.approx(3.0)
    np.testing.assert_allclose(poses.sum(axis=0), 0.0, atol=1e-9)
