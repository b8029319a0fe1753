"""What the motors of a robot of any kind did tells whether it is the described one."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Rests
from ccr_host.run.response_check import MotorResponses

SHIPPED = "single", "two-spatial", "three-spatial"
REACH_RAD = np.radians(25.0)
SEEDS = st.integers(0, 10_000)
MATCHING = 6.0
"""Cost that another explanation must save."""


def responses(name: str, seed: int, led=lambda q: q, turn=None) -> MotorResponses:
    """Those of a robot that sags, with motors that bend it further or less than described."""
    rng = np.random.default_rng(seed)
    description = schema.load(name)
    model = ConstantCurvature(description.robot)
    q_rad = np.vstack([np.zeros(model.motors), REACH_RAD * np.eye(model.motors)])
    sag_rad = rng.normal(0.0, 0.08, len(model.segment_of_freedom))
    shares = rng.uniform(0.6, 1.4, model.motors)
    places, _ = model.markers_mm(sag_rad + model.bending_rad(shares * led(q_rad)))
    vectors_mm = places[:, [0, -1]] + rng.normal(0.0, 0.1, (len(q_rad), 2, 3))
    rests = Rests.of_vectors(q_rad[0], q_rad, vectors_mm, np.ones(len(q_rad)))
    return MotorResponses(description, rests if turn is None else rests.turned(turn.as_matrix()))


def cause(found: MotorResponses) -> str:
    named = found.likeliest().cause_and_cure()
    return "" if named is None else named[0]


@settings(max_examples=20, deadline=None)
@given(name=st.sampled_from(SHIPPED), seed=SEEDS)
def test_a_robot_that_sags_and_slacks_is_the_described_one(name, seed) -> None:
    found = responses(name, seed)
    assert not len(found.idle())
    assert found.worst_off_rad() < np.radians(45.0)
    assert found.as_described().cost - found.likeliest().cost < MATCHING


@pytest.mark.parametrize("name", SHIPPED)
def test_each_reversed_motor_is_named(name) -> None:
    for motor in range(schema.load(name).robot.motors):
        signs = np.ones(schema.load(name).robot.motors)
        signs[motor] = -1.0
        found = responses(name, motor, lambda q, signs=signs: q * signs)
        assert cause(found) == f"motor {motor + 1} reversed"
        assert found.as_described().cost - found.likeliest().cost > MATCHING


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
    found = responses(name, seed, turn=Rotation.from_rotvec(vector))
    assert "the camera stands" in cause(found)
    assert found.as_described().cost - found.likeliest().cost > MATCHING


def test_a_motor_without_tendons_is_named_by_its_number() -> None:
    found = responses("two-spatial", 1, lambda q: q * (1.0, 1.0, 0.0, 1.0))
    assert found.idle().tolist() == [2]
