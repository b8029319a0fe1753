"""What has changed in a robot of any kind in mid-run is named."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.changed_robot import likely_change

ROBOTS = None, "two-spatial"
LOOKS = 8


class Case:
    """Looks along a path at a robot that follows constant curvature, not quite."""

    def __init__(self, name: str | None) -> None:
        description = schema.load(name)
        self.model = ConstantCurvature(description.robot)
        self.limits = MotorLimits.of(description.servo)
        self.rng = np.random.default_rng(1)
        phase = np.linspace(0.0, 2.0, LOOKS)[:, None] + np.arange(self.model.motors)
        self.q_rad = 0.5 * np.sin(phase)

    def seen_mm(self, q_rad: np.ndarray) -> np.ndarray:
        exact_mm = self.predict(q_rad)
        return exact_mm + self.rng.normal(0.0, 1.0, exact_mm.shape)

    def predict(self, q_rad: np.ndarray) -> np.ndarray:
        return self.model.markers_mm(self.model.bending_rad(q_rad))[0]

    def change(self, seen_mm: np.ndarray) -> str:
        _, by_bending = self.model.markers_mm(self.model.bending_rad(self.q_rad))
        found = likely_change(self.predict, self.limits, self.q_rad, seen_mm, by_bending)
        return " (".join(found or ("",))


@pytest.fixture(params=ROBOTS)
def case(request) -> Case:
    return Case(request.param)


def test_what_became_of_each_motor_is_named(case) -> None:
    for motor in range(case.model.motors):
        for change, told in (
            (lambda own: np.full_like(own, -0.4), "no longer"),
            (lambda own: own - 0.6, "has slipped, by -3"),
            (lambda own: -own, "turns the other way"),
            (lambda own: np.minimum(own, own.min() + 0.1), "no longer"),
        ):
            led_rad = case.q_rad.copy()
            led_rad[:, motor] = change(led_rad[:, motor])
            named = case.change(case.seen_mm(led_rad))
            assert named.startswith(f"most likely motor {motor + 1} ")
            assert told in named


@pytest.mark.parametrize("turn_deg", [(20, 0, 0), (0, -25, 0), (0, 0, 90), (100, 100, 0)])
def test_a_camera_that_was_turned_is_named_with_its_angle(case, turn_deg) -> None:
    turn = Rotation.from_rotvec(turn_deg, degrees=True)
    named = case.change(case.seen_mm(case.q_rad) @ turn.as_matrix().T)
    found = re.search(r"camera has been turned by (\d+) deg .*register", named)
    assert found is not None
    assert int(found[1]) == pytest.approx(np.degrees(turn.magnitude()), abs=2.0)


@pytest.mark.parametrize(
    ("robot", "moved", "told"),
    [
        ("single", [0], "M1 or the last marker"),
        *((robot, [0, 1], "M1") for robot in ROBOTS),
        *((robot, [0], "M2") for robot in ROBOTS),
        *((robot, [1], "the last marker") for robot in ROBOTS),
        ("three-spatial", [0, 1, 2], "M1"),
        ("three-spatial", [0], "M2"),
        ("three-spatial", [1], "M3"),
        ("three-spatial", [2], "the last marker"),
    ],
)
def test_a_marker_that_came_loose_is_named(robot, moved, told) -> None:
    case = Case(robot)
    seen_mm = case.seen_mm(case.q_rad)
    seen_mm[:, moved] += np.array((20.0, 0.0, -15.0))
    shift_mm = (seen_mm - case.predict(case.q_rad))[:, moved].mean(axis=(0, 1))
    assert shift_mm == pytest.approx((20.0, 0.0, -15.0), abs=1.2)
    by_mm = np.linalg.norm(shift_mm)
    assert f" {told} has shifted on the robot by {by_mm:.0f} mm" in case.change(seen_mm)


@pytest.mark.parametrize("marker", [0, 1])
def test_a_loose_marker_is_named_though_the_model_has_the_bending_wrong(marker) -> None:
    """Bending takes the last marker 10 mm away, the loose one has slid by 10 mm."""
    case = Case("three-spatial")
    wrong_rad = case.rng.normal(0.0, 0.06, (LOOKS, 6))
    seen_mm, _ = case.model.markers_mm(case.model.bending_rad(case.q_rad) + wrong_rad)
    seen_mm[:, marker, 1] += 10.0
    found = re.search(rf"M{marker + 2} has shifted on the robot by (\d+) mm", case.change(seen_mm))
    assert found is not None
    assert int(found[1]) == pytest.approx(10, abs=2)


def test_other_units_of_a_camera_are_named(case) -> None:
    assert "seen 1.5 times as long" in case.change(1.5 * case.seen_mm(case.q_rad))


def test_markers_that_stand_still_are_the_trackers_or_all_servos(case) -> None:
    seen_mm = case.predict(case.q_rad[:1] - 0.4).repeat(LOOKS, axis=0)
    assert "repeats its picture, no servo turns" in case.change(seen_mm)
    seen_mm[:, 0] = np.nan
    assert "repeats its picture, no servo turns" in case.change(seen_mm)


def test_a_servo_that_stopped_is_not_taken_for_a_marker_alone_while_the_motors_hardly_move() -> (
    None
):
    case = Case("two-spatial")
    case.q_rad = 0.05 * case.q_rad + np.array((0.1, 0.0, 0.3, 0.0))
    led_rad = case.q_rad.copy()
    led_rad[:, 2] = -0.1
    named = case.change(case.seen_mm(led_rad))
    assert "motor 3" in named
    assert "or the last marker has shifted" in named
    assert "check its servo" in named
    assert "ccr-host register" in named


@pytest.mark.parametrize("robot", [*ROBOTS, "single", "three-spatial"])
def test_what_nothing_usual_explains_is_not_explained(robot) -> None:
    case = Case(robot)
    shape = case.seen_mm(case.q_rad).shape
    assert case.change(case.rng.normal(0.0, 0.6 * sum(case.model.lengths_mm), shape)) == ""
