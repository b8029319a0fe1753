"""What the motors of a robot of any kind did tells whether it is the described one."""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.misfit import LEFT_HANDED, MisfitError
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Rests
from ccr_host.run.execute import execute
from ccr_host.run.motor_responses import MotorResponses
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult

SHIPPED = "single", "two-spatial", "three-spatial"
REACH_RAD = np.radians(25.0)
SEEDS = st.integers(0, 10_000)
MATCHING = 6.0
"""Cost that another explanation must save."""


def responses(name: str, seed: int, led=lambda q: q, frame=None) -> MotorResponses:
    """Those of a robot that sags, with motors that bend it further or less than described."""
    rng = np.random.default_rng(seed)
    description = schema.load(name)
    model = ConstantCurvature(description.robot)
    q_rad = np.vstack([np.zeros(model.motors), REACH_RAD * np.eye(model.motors)])
    sag_rad = rng.normal(0.0, 0.08, len(model.segment_of_freedom))
    shares = rng.uniform(0.6, 1.4, model.motors)
    places, _ = model.markers_mm(sag_rad + model.bending_rad(shares * led(q_rad)))
    vectors_mm = places + rng.normal(0.0, 0.1, places.shape)
    rests = Rests.of_vectors(q_rad, q_rad, vectors_mm, np.ones(len(q_rad)))
    return MotorResponses(description, rests if frame is None else rests.turned(frame))


def cause(found: MotorResponses) -> str:
    named = found.likeliest().cause_and_cure()
    return "" if named is None else named[0].removeprefix("most likely ")


@settings(max_examples=20, deadline=None)
@given(name=st.sampled_from(SHIPPED), seed=SEEDS)
def test_a_robot_that_sags_and_slacks_is_the_described_one(name, seed) -> None:
    found = responses(name, seed)
    assert not len(found.idle())
    off_rad = np.arccos(np.diag(found.responses.cosines()))
    assert off_rad.max() < np.radians(45.0)
    assert found.as_described().cost - found.likeliest().cost < MATCHING


@pytest.mark.parametrize("name", SHIPPED)
def test_each_reversed_motor_is_named(name) -> None:
    for motor in range(schema.load(name).robot.motors):
        signs = np.ones(schema.load(name).robot.motors)
        signs[motor] = -1.0
        found = responses(name, motor, lambda q, signs=signs: q * signs)
        assert cause(found) == f"motor {motor + 1} reversed"
        assert found.as_described().cost - found.likeliest().cost > MATCHING


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED[1:])
def test_every_two_exchanged_motors_are_named(name) -> None:
    motors = schema.load(name).robot.motors
    for seed, (first, second) in enumerate(combinations(range(motors), 2)):
        order = np.arange(motors)
        order[[first, second]] = second, first
        found = responses(name, seed, lambda q, order=order: q[:, order])
        assert cause(found) == f"motors {first + 1} and {second + 1} are exchanged"
        assert found.as_described().cost - found.likeliest().cost > MATCHING


@settings(max_examples=20, deadline=None)
@given(name=st.sampled_from(SHIPPED[1:]), seed=SEEDS, turn_deg=st.floats(60, 120))
def test_a_turned_camera_is_told_from_exchanged_motors(name, seed, turn_deg) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    vector = np.radians(turn_deg) * axis / np.linalg.norm(axis)
    found = responses(name, seed, frame=Rotation.from_rotvec(vector).as_matrix())
    assert "the camera stands" in cause(found)
    assert found.as_described().cost - found.likeliest().cost > MATCHING


@pytest.mark.parametrize("name", SHIPPED[1:])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_left_handed_axes_are_told_from_reversed_and_exchanged_motors(name, axis) -> None:
    mirrored = responses(name, axis, frame=np.diag(1.0 - 2.0 * np.eye(3)[axis]))
    assert cause(mirrored) == LEFT_HANDED[0]
    assert mirrored.as_described().cost - mirrored.likeliest().cost > MATCHING


def test_a_motor_without_tendons_is_named_by_its_number() -> None:
    found = responses("two-spatial", 1, lambda q: q * (1.0, 1.0, 0.0, 1.0))
    assert found.idle().tolist() == [2]


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., RunResult]:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,-5,10\n2,5,15\n")

    def checked(name: str, *overrides: str) -> RunResult:
        options = RunOptions(
            path=str(path), robot=name, controller="open-loop", overrides=overrides, checks="motion"
        )
        return execute(options, RunObserver(), lambda *_: None)

    return checked


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_the_twin_of_each_shipped_robot_is_the_described_one(run, name) -> None:
    assert run(name).failure is None
    assert run(name, "twin.friction=0.2", "twin.stiffness_taper=0.2").failure is None


@pytest.mark.long
@pytest.mark.parametrize("path", ["circle", "dome8"])
def test_slack_of_single_tendons_that_few_moves_do_not_show_does_not_end_the_path(
    tmp_path, path
) -> None:
    """Fitted from taut tendons alone, it was stopped as if motor 1 or 2 had slipped."""
    file = tmp_path / "three-tendons.toml"
    tied = ", ".join(f"{{angle_deg = {120 * n - 120}, motor = {n}}}" for n in (1, 2, 3))
    segment = f'length_mm = 70\ntendon_radius_mm = 5\nbends = "space"\ntendons = [{tied}]'
    file.write_text(f"[robot]\npulley_radius_mm = 10\n[[robot.segments]]\n{segment}\n")
    options = RunOptions(path=path, robot=str(file), controller="pid-ik", checks="motion")
    assert options.description().twin.slack_mm == (1.2,) * 3
    assert execute(options, RunObserver(), lambda *_: None).failure is None


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "override", "told"),
    [
        ("single", "twin.servo_us_per_90_deg=-1000", "motor 1 reversed"),
        ("two-spatial", "twin.servo_us_per_90_deg=[1000,1000,-1000,1000]", "motor 3 reversed"),
        ("two-spatial", "tracker.rotation_deg=[0,60,0]", "the camera stands otherwise"),
        ("three-spatial", "tracker.rotation_deg=[40,0,0]", "the camera stands otherwise"),
        ("single", "twin.servo_neutral_us=1411", "zero of motor 1 is off by -8"),
        (
            "two-spatial",
            "twin.servo_neutral_us=[1500,1411,1500,1500]",
            "zero of motor 2 is off by -8",
        ),
        ("two-spatial", "twin.segment_lengths_mm=[78,60]", "length_1_mm is 75 where 60"),
        ("two-spatial", "twin.segment_lengths_mm=[60,42]", "length_2_mm is 45 where 60"),
        ("two-spatial", "twin.servo_us_per_90_deg=[1000,500,1000,1000]", "pulse_per_90_deg_us"),
        ("three-spatial", "twin.segment_lengths_mm=[50,50,35]", "length_"),
        (
            "three-spatial",
            "twin.servo_us_per_90_deg=[1000,1000,1000,1000,1000,1000,-1000,1000,1000]",
            "motor 7 reversed",
        ),
    ],
)
def test_a_twin_that_is_not_the_described_one_ends_before_the_path(
    run, name, override, told
) -> None:
    result = run(name, override)
    assert isinstance(result.failure, MisfitError)
    assert told in str(result.failure)
    assert not result.records
