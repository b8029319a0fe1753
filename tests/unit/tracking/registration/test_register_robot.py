"""The whole routine on the emulated board and the twin, and what it is for: closed loops."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.control.registry import make_controller
from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Servo
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import reference_of
from ccr_host.run.loop import follow_path
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.tools.register import register_robot, safe_poses_rad
from ccr_host.tracking.registration import RegistrationError
from ccr_host.tracking.tracker import Sample
from tests.unit.tracking.registration.conftest import TURNS


def turned(rotation_rad, robot=None, **keys) -> RunOptions:
    degrees = ",".join(f"{angle:.9f}" for angle in np.degrees(rotation_rad))
    overrides = (f"tracker.rotation_deg=[{degrees}]",)
    return RunOptions(path="8shape", controller="mpc", robot=robot, overrides=overrides, **keys)


def registered(options: RunOptions):
    description = options.description()
    with open_rig(options, description, Observers()) as rig:
        return register_robot(rig, description, lambda *_: None)


@dataclass(frozen=True)
class InRobotFrame:
    """What a tracker does with a registration."""

    tracker: object
    camera_to_robot: np.ndarray
    name: str = "registered"

    def newest(self):
        sample = self.tracker.newest()
        return None if sample is None else self.turned(sample)

    def arrived(self):
        return [self.turned(sample) for sample in self.tracker.arrived()]

    def turned(self, sample):
        return Sample(sample.exposed_us, sample.markers_mm @ self.camera_to_robot.T)

    def trouble(self) -> str:
        return ""


def mean_errors_mm(options: RunOptions, camera_to_robot) -> tuple[float, float]:
    """As measured and true."""
    description = options.description()
    controller = make_controller(options.controller, description)
    recorder = Observers()
    with open_rig(options, description, recorder) as in_camera_frame:
        tracker = InRobotFrame(in_camera_frame.tracker, camera_to_robot)
        rig = replace(in_camera_frame, tracker=tracker)
        reference = reference_of(options)
        records = follow_path(rig, controller, reference, description, recorder, lambda *_: None)
    measured, true = (
        np.mean([np.linalg.norm(getattr(r, place) - r.target_mm) for r in records])
        for place in ("measured_mm", "true_mm")
    )
    return float(measured), float(true)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["default", "hard", "loose-tendons", "tool-tip"])
def test_the_shipped_robots_are_registered_to_a_degree(robot):
    found = registered(turned(TURNS["askew"], robot))
    error = Rotation.from_matrix(found.camera_to_robot) * Rotation.from_rotvec(TURNS["askew"]).inv()
    assert np.max(np.abs(error.as_rotvec(degrees=True))) < 1.0


@pytest.mark.long
def test_a_robot_with_every_effect_is_registered_as_precisely_as_stated():
    """Without its turned bending plane, which defines the frame (docs/registration.md)."""
    options = turned(TURNS["askew"], "dirty")
    flat = "twin.bending_plane_turn_deg=[0.0,0.0]"
    found = registered(replace(options, overrides=(*options.overrides, flat)))
    error = Rotation.from_matrix(found.camera_to_robot) * Rotation.from_rotvec(TURNS["askew"]).inv()
    assert np.all(np.abs(error.as_rotvec(degrees=True)) < 2.0 * found.uncertainty_deg)
    assert found.hysteresis_mm[0] > 1.0


@pytest.mark.long
@pytest.mark.parametrize("turn", [pytest.param("half turn", marks=pytest.mark.slow), "askew"])
def test_the_closed_loop_is_as_good_as_with_an_aligned_camera(turn):
    aligned = mean_errors_mm(turned(TURNS["aligned"]), np.eye(3))
    options = turned(TURNS[turn])
    corrected = mean_errors_mm(options, registered(options).camera_to_robot)
    np.testing.assert_allclose(corrected, aligned, rtol=0.05)


@pytest.mark.long
def test_a_camera_that_sees_nothing_is_told(monkeypatch):
    options = turned(TURNS["aligned"])
    description = options.description()
    with open_rig(options, description, Observers()) as rig:
        monkeypatch.setattr(rig.tracker, "newest", lambda: None)
        with pytest.raises(TrackerError, match="no markers from twin"):
            register_robot(rig, description, lambda *_: None)


@pytest.mark.long
def test_servos_with_dead_power_are_noticed():
    options = RunOptions(path="8shape", overrides=("twin.servo_rate_deg_s=0.01",))
    with pytest.raises(RegistrationError, match="swung by"):
        registered(options)


def test_poses_stay_well_inside_the_limits():
    limits = MotorLimits.of(Servo(angle_min_deg=(-20.0, -5.0), angle_max_deg=(60.0, 85.0)))
    poses = np.degrees(safe_poses_rad(limits))
    assert np.max(np.abs(poses[:, 0])) == pytest.approx(12.0)
    assert np.max(np.abs(poses[:, 1])) == pytest.approx(3.0)
    np.testing.assert_allclose(poses.sum(axis=0), 0.0, atol=1e-9)
