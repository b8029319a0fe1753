"""What the MPC starts from, on robots that bend otherwise than their motors say."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from bench.any_robot import random_robot
from ccr_host.control.base import Observation
from ccr_host.control.mpc.controller import AsMeasured, BendingFilter, ModelPredictive
from ccr_host.control.mpc.problem import Weights
from ccr_host.control.registry import rate_note
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace
from ccr_host.run.execute import execute_quietly
from ccr_host.run.observer import true_errors_mm
from ccr_host.run.options import RunOptions

UNSEEN = np.full((1, 3), np.nan)


def seen(step, tip_mm, q_rad, ends_mm=UNSEEN, period_s=1.0, age_s=0.04):
    time_us = round(step * period_s * 1e6)
    tip = None if tip_mm is None else np.asarray(tip_mm, dtype=float)
    return Observation(step, time_us, tip, round(age_s * 1e6), q_rad, ends_mm)


def swings(model, count, rng):
    """Motor angles that bend the robot by up to half a radian, (count, n)."""
    phases = rng.uniform(0.0, 2.0 * np.pi, model.motors)
    q_rad = np.sin(0.3 * np.arange(count)[:, None] + phases)
    return 0.5 * q_rad / np.abs(model.bending_rad(q_rad)).max()


@pytest.mark.parametrize("segments", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(6))
def test_filter_finds_how_a_robot_bends_from_the_ends_of_its_segments(segments, seed):
    rng = np.random.default_rng(seed)
    model = ConstantCurvature(random_robot(rng, segments, lengths_mm=(50.0, 100.0)))
    estimate = BendingFilter(model)
    more_rad = rng.uniform(-0.3, 0.3, len(model.segment_of_freedom))
    for step, q_rad in enumerate(swings(model, 30, rng), 1):
        bending_rad = model.bending_rad(q_rad) + more_rad
        ends_mm = model.markers_mm(bending_rad[None])[0][0]
        pose = estimate.pose(seen(step, ends_mm[-1], q_rad, ends_mm), q_rad)
    # The prior expects a bending to be 2 % less a second later, at which the pose is.
    assert model.bending_rad(pose.extra_rad) == pytest.approx(more_rad, abs=0.025 * segments)
    assert pose.tip_mm == pytest.approx(ends_mm[-1], abs=0.75 * segments)


def test_filter_predicts_the_tip_at_the_last_command_from_a_picture_of_an_earlier_one():
    model = ConstantCurvature(schema.load("two-spatial").robot)
    estimate = BendingFilter(model)
    angles = swings(model, 40, np.random.default_rng(1))
    for step in range(1, len(angles)):
        age_s = 0.04  # The last command was given 50 ms ago and took effect 13 ms later.
        tip_mm = model.tip_mm(angles[max(step - 1, 1)])  # It has stood at the first command.
        now = seen(step, tip_mm, angles[step], period_s=0.05, age_s=age_s)
        pose = estimate.pose(now, angles[step])
    assert pose.tip_mm == pytest.approx(model.tip_mm(angles[-1]), abs=0.1)


@pytest.mark.parametrize("make", [AsMeasured, BendingFilter])
def test_without_a_measurement_the_last_error_of_the_model_is_kept(make):
    robot = schema.load("two-spatial").robot
    model = ConstantCurvature(robot)
    estimate = make(model)
    angles = 0.1 * np.eye(4)
    error_mm = np.array([0.5, -0.3, 0.2])
    for step in range(20):
        estimate.pose(seen(step + 1, model.tip_mm(angles[0]) + error_mm, angles[0]), angles[0])
    tip_mm = estimate.pose(seen(21, None, angles[1]), angles[1]).tip_mm
    assert tip_mm == pytest.approx(model.tip_mm(angles[1]) + error_mm, abs=0.1)


def on_a_helix(rate_hz):
    description = schema.load("two-spatial")
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    path = load_path("helix", rate_hz, Workspace(model, limits))
    return model, limits, path, ModelPredictive(description)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wild_mm", [1e3, 1e200, 1e300])
def test_a_wild_measurement_is_soon_forgotten(wild_mm):
    model, limits, path, controller = on_a_helix(1.0)
    q_rad = controller.start(path).q_rad
    for step in range(1, 30):
        ends_mm = model.markers_mm(model.bending_rad(q_rad)[None])[0][0]
        off_mm = np.linalg.norm(ends_mm[-1] - path.target_mm[step - 1])
        tip_mm = [wild_mm, -wild_mm, wild_mm] if step == 5 else ends_mm[-1]
        q_rad = controller.step(seen(step, tip_mm, q_rad, ends_mm)).q_rad
        assert np.array_equal(limits.clip(q_rad), q_rad)
    assert off_mm < 1.0


@pytest.mark.parametrize("gain", [0.6, 1.3])
def test_mpc_follows_at_20_hz_a_robot_that_is_late_and_bends_otherwise(gain):
    model, _, path, controller = on_a_helix(20.0)
    q_rad = controller.start(path).q_rad
    under_way, turned_rad = deque([q_rad] * 2), q_rad
    off_mm = []
    for step in range(1, 400):
        turned_rad = turned_rad + 0.7 * (under_way.popleft() - turned_rad)
        ends_mm = model.markers_mm(gain * model.bending_rad(turned_rad)[None])[0][0]
        off_mm.append(np.linalg.norm(ends_mm[-1] - path.target_mm[step - 1]))
        now = seen(step, ends_mm[-1], q_rad, ends_mm, period_s=0.05)
        q_rad = controller.step(now).q_rad
        under_way.append(q_rad)
    assert np.max(off_mm[100:]) < 1.5


AS_PRINTED = ["control.bending=commanded"]


@pytest.mark.long
@pytest.mark.parametrize("path", ["ellipse", pytest.param("star", marks=pytest.mark.slow)])
def test_a_robot_past_its_model_s_fold_is_not_lost_as_by_the_mpc_as_printed(path):
    """Between both folds J of the commanded angles has the wrong sign, see docs/twin.md."""

    def mean_mm(*overrides):
        options = RunOptions(path, "mpc", robot="dirty", overrides=overrides, checks="none")
        errors_mm = true_errors_mm(execute_quietly(options).records)
        assert errors_mm is not None
        return np.linalg.norm(errors_mm, axis=1).mean()

    assert mean_mm() < 5.0
    assert mean_mm(*AS_PRINTED) > 20.0


@pytest.mark.parametrize("robot", ["default", "two-spatial"])
def test_the_mpc_as_printed_alone_is_warned_of_short_periods(robot):
    printed = schema.load(robot, overrides=AS_PRINTED)
    assert "leaves out the delays" in rate_note("mpc", 20.0, printed)
    assert not rate_note("mpc", 5.0, printed)
    assert not rate_note("mpc", 20.0, schema.load(robot))
    assert not rate_note("mpc-offset", 20.0, printed)


def test_the_description_of_the_paper_s_robot_has_the_mpc_as_printed():
    assert schema.load("paper").control.bending == "commanded"
    assert Weights.of(schema.load("paper")) == Weights(1.0, 0.5)
