"""What the few moves before a path tell of a robot of any kind, and what they leave open."""

import numpy as np
import pytest

from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.open_loop import OpenLoop
from ccr_host.description.schema import Description, Robot, Segment, Tendon
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Motors, Rests
from ccr_host.run.motor_responses import ProbeLaw, probe_stops
from ccr_host.run.robot_check import LedAwayError, RobotCheck

REACH_RAD = np.radians(20.0)


def description(tendons: int, *, pairs: bool = False, pulley_mm: float = 10.0) -> Description:
    """One spatial segment with single tendons around it, or pairs of opposite ones."""
    angles_deg = 360.0 / tendons * np.arange(tendons) - 120.0
    motors, windings = np.arange(tendons) + 1, np.ones(tendons, int)
    if pairs:
        motors, windings = np.arange(tendons) % (tendons // 2) + 1, 1 - 2 * (motors > tendons // 2)
    pulls = zip(angles_deg.tolist(), motors.tolist(), windings.tolist(), strict=True)
    tied = tuple(Tendon(angle_deg=a, motor=m, winding=w) for a, m, w in pulls)
    segment = Segment(length_mm=70.0, tendon_radius_mm=5.0, bends="space", tendons=tied)
    return Description(robot=Robot(segments=(segment,), pulley_radius_mm=pulley_mm))


def robot(described: Description, slack_mm: float):
    """The model, its parameters, and the scores of a robot that matches but for slack."""
    model, space = make_static_model(described)
    space = space.of_few_rests()
    score = np.zeros(space.count)
    score[[name.startswith("slack") for name in space.names]] = slack_mm
    return model, space, score


def rests_of(described: Description, slack_mm: float, motors: Motors | None = None) -> Rests:
    """The rests of the few moves of a robot that matches but for slack and what motors do."""
    model, space, score = robot(described, slack_mm)
    q_rad = REACH_RAD * probe_stops(described.robot)
    count = np.full(len(q_rad), 13.0)
    at_rest = Rests.of_vectors(q_rad, q_rad, np.zeros((len(q_rad), 2, 3)), count)
    led = at_rest if motors is None else motors.drive(at_rest)
    vectors_mm = model.predicted_mm(space.parameters(score), led)
    return Rests.of_vectors(q_rad, q_rad, vectors_mm, count)


def along(described: Description, q_rad: np.ndarray) -> Reference:
    """The path on which constant curvature has the robot at these motor angles."""
    constant = ConstantCurvature(described.robot)
    targets_mm = constant.markers_mm(constant.bending_rad(q_rad))[0][:, -1]
    steps = np.arange(float(len(q_rad)))
    return Reference("path", 1.0, steps, targets_mm, q_rad, 0.0 * steps)


def judged(described: Description, rests: Rests) -> ProbeLaw:
    law = ProbeLaw(described)
    for _ in law._judging(rests):
        pass
    return law


@pytest.mark.parametrize("slack_mm", [0.0, 0.3, 1.2, 2.0])
@pytest.mark.parametrize(("tendons", "pairs"), [(3, False), (4, False), (4, True)])
def test_slack_is_no_misfit_and_where_it_leads_is_not_odd_along_the_path(
    tendons, pairs, slack_mm, monkeypatch
) -> None:
    described = description(tendons, pairs=pairs)
    model, space, score = robot(described, slack_mm)
    second = np.arange(40)[:, None]
    q_rad = 0.6 * np.sin(0.15 * second + np.arange(described.robot.motors))
    check = RobotCheck(described, OpenLoop(described), along(described, q_rad), "")
    rests = rests_of(described, slack_mm)
    check._probe = judged(described, rests)
    monkeypatch.setattr(ProbeLaw, "rests", rests)
    assert check.judge_probe() is None
    for step, led_rad in enumerate(q_rad):
        pose = model.first_pose(space.parameters(score), led_rad)
        seen_mm = model.markers_mm(space.parameters(score), pose.theta_rad[None])[0]
        assert check.judge_step(step, 1_000_000 * step, led_rad, seen_mm) is None


@pytest.mark.parametrize("away", [1.0, -1.0])
def test_a_controller_that_does_worse_than_the_open_loop_is_told_from_a_robot_that_fails(
    away, monkeypatch
) -> None:
    described = description(3)
    model, space, score = robot(described, 0.3)
    q_rad = np.tile([0.6, -0.3, -0.3], (8, 1))
    check = RobotCheck(described, OpenLoop(described), along(described, q_rad), "")
    rests = rests_of(described, 0.3)
    check._probe = judged(described, rests)
    monkeypatch.setattr(ProbeLaw, "rests", rests)
    assert check.judge_probe() is None
    found = []
    for step, led_rad in enumerate(away * q_rad):
        pose = model.first_pose(space.parameters(score), led_rad)
        seen_mm = model.markers_mm(space.parameters(score), pose.theta_rad[None])[0]
        found.append(check.judge_step(step, 1_000_000 * (step + 1), led_rad, seen_mm))
    if away > 0.0:
        assert found == [None] * 8
    else:
        assert found[:3] == [None] * 3
        assert isinstance(found[3], LedAwayError)
        assert "mm off" in found[3].cause


def test_slack_that_hides_a_move_is_no_idle_motor_and_asks_for_farther_ones() -> None:
    described = description(3, pulley_mm=6.0)
    law = judged(described, rests_of(described, 2.0))
    assert law.explanation is None
    assert law._is_doubtful()


@pytest.mark.parametrize(
    ("signs", "order", "told"),
    [
        ((1.0, 0.0, 1.0), (0, 1, 2), "motor 2 hardly moves it"),
        ((1.0, 1.0, 1.0), (1, 0, 2), "most likely motors 1 and 2 are exchanged"),
    ],
)
def test_motors_that_act_otherwise_explain_the_moves_better(signs, order, told) -> None:
    described = description(3)
    law = judged(described, rests_of(described, 1.2, Motors(signs, order)))
    assert law.explanation.cause_and_cure()[0] == told
