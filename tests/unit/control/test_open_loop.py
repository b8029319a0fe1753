"""Algorithm 2."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.base import Observation, Outcome
from ccr_host.control.open_loop import OpenLoop
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits, Workspace

DEFAULT = schema.load()
MODEL = ConstantCurvature(DEFAULT.robot)


def reference(name, rate_hz=1.0, description=DEFAULT):
    limits = MotorLimits.of(description.servo)
    return load_path(name, rate_hz, Workspace(ConstantCurvature(description.robot), limits))


def angles(path, description=DEFAULT, tip_mm=None):
    controller = OpenLoop(description)
    commands = [controller.start(path)]
    for step in range(1, len(path)):
        seen = Observation(step, 0, tip_mm, 0, commands[-1].q_rad)
        commands.append(controller.step(seen))
    assert {c.outcome for c in commands} == {Outcome.SOLVED}
    return np.array([c.q_rad for c in commands])


@pytest.mark.parametrize("name", ["ellipse", "8shape", "star"])
def test_increments_are_those_of_algorithm_2(name):
    path = reference(name)
    q = angles(path)
    for i in range(1, len(path)):
        inverse = np.linalg.pinv(MODEL.jacobian_mm_rad(path.q_rad[i - 1]))
        assert q[i] - q[i - 1] == pytest.approx(
            inverse @ (path.target_mm[i] - path.target_mm[i - 1]), abs=1e-12
        )


@pytest.mark.long
@pytest.mark.parametrize(("name", "within_mm"), [("ellipse", 1.4), ("8shape", 0.7), ("star", 3.0)])
def test_model_stays_near_the_path_and_nearer_at_a_higher_rate(name, within_mm):
    """Linearisation at one step a second is the price of Algorithm 2."""

    def mean_error_mm(rate_hz):
        path = reference(name, rate_hz)
        return np.linalg.norm(MODEL.tip_mm(angles(path)) - path.target_mm, axis=1).mean()

    assert mean_error_mm(1.0) < within_mm
    assert mean_error_mm(20.0) < mean_error_mm(1.0)


def test_measurements_change_nothing():
    path = reference("8shape")
    assert np.array_equal(angles(path), angles(path, tip_mm=np.array([1.0, 2.0, 3.0])))


def test_motor_limits_are_kept():
    tight = schema.load(overrides=["servo.angle_min_deg=-12", "servo.angle_max_deg=12"])
    q = np.degrees(angles(reference("ellipse", description=tight), tight))
    assert np.abs(q).max() <= 12.0 + 1e-9


def test_direction_that_no_motor_can_move_is_dropped():
    """Where J loses rank the pseudo-inverse alone would ask for boundless steps."""
    # Long second segment, short first: J is nearly singular with both segments rolled up.
    odd = schema.load(
        overrides=[
            "robot.segment_lengths_mm=[5.0, 1000.0]",
            "robot.marker_offset_mm=0",
            "servo.angle_min_deg=-130",
            "servo.angle_max_deg=130",
        ]
    )
    model = ConstantCurvature(odd.robot)
    grid = np.stack(np.meshgrid(np.linspace(0, 2, 81), np.linspace(0.5, 2, 301)), axis=-1)
    grid = grid.reshape(-1, 2)
    singular = np.linalg.svd(model.jacobian_mm_rad(grid), compute_uv=False)
    worst = grid[np.argmin(singular[:, 1] / singular[:, 0])]
    assert (singular[:, 1] / singular[:, 0]).min() < 0.05
    tip = model.tip_mm(worst)
    _, _, directions = np.linalg.svd(model.jacobian_mm_rad(worst).T)
    lost = directions[1]
    path = Reference(
        "fold",
        1.0,
        np.arange(2.0),
        np.array([tip, tip + lost]),
        np.array([worst, worst]),
        np.zeros(2),
    )
    assert angles(path, odd)[1] == pytest.approx(worst, abs=1e-9)
