"""Every controller for robots of 1, 2, 4 and 9 motors."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from ccr_host.control.base import Controller, Observation, Outcome
from ccr_host.control.registry import baseline_names, controller_names, make_controller
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits, Workspace

SHIPPED = {
    "single": "swing",
    "default": "8shape",
    "two-spatial": "helix",
    "three-spatial": "circle",
}
NAMES = [*controller_names(), *baseline_names()]
PERIOD_US = 200_000
WEIRD = ([math.nan, 0.0, 0.0], [math.inf, 0.0, 0.0], [1e200, 0.0, 0.0], [1e4, -1e4, 1e4], None)


@cache
def followed(robot: str) -> tuple[Description, Reference]:
    description = schema.load(robot)
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    return description, load_path(SHIPPED[robot], 5.0, Workspace(model, limits))


def made(robot: str, name: str) -> tuple[Controller, Description, Reference]:
    description, path = followed(robot)
    return make_controller(name, description), description, path


@pytest.mark.parametrize("robot", SHIPPED)
@pytest.mark.parametrize("name", NAMES)
def test_whatever_is_measured_no_step_raises_and_commands_stay_within_the_limits(robot, name):
    controller, description, path = made(robot, name)
    limits = MotorLimits.of(description.servo)
    command = controller.start(path)
    rng = np.random.default_rng(1)
    for step in range(1, 40):
        weird = WEIRD[step % len(WEIRD)]
        tip_mm = np.array(weird) if weird is not None else None
        if step % 3 == 0:
            tip_mm = rng.normal(scale=100.0, size=3)
        q_rad = command.q_rad if step % 7 else np.full(description.robot.motors, np.nan)
        time_us = step * PERIOD_US
        command = controller.step(Observation(step, time_us, tip_mm, 50_000, q_rad))
        assert command.q_rad.shape == (description.robot.motors,)
        assert np.array_equal(command.q_rad, limits.clip(command.q_rad))
        assert np.isfinite(command.predicted_mm).all()


@pytest.mark.parametrize("robot", SHIPPED)
@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("open-loop", "adaptive")])
def test_on_a_robot_as_believed_that_hangs_a_little_the_tip_comes_to_the_path(robot, name):
    """`adaptive` would first explore the robot, see tests/unit/control/adaptive."""
    controller, description, path = made(robot, name)
    model = ConstantCurvature(description.robot)
    sag_mm = np.array([0.0, 0.0, -2.0])
    command = controller.start(path)
    missed_mm = []
    for step in range(1, 100):
        tip_mm = model.tip_mm(command.q_rad) + sag_mm
        missed_mm.append(float(np.linalg.norm(tip_mm - path.target_mm[step - 1])))
        seen = Observation(step, step * PERIOD_US, tip_mm, 0, command.q_rad)
        command = controller.step(seen)
        assert command.outcome is not Outcome.HELD
    # What one or two motors cannot reach stays.
    assert np.mean(missed_mm[-50:]) < (2.1 if description.robot.motors < 3 else 1.0)
