"""The static model of any robot: inverse, derivatives, fit; the paper's robot by both models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.any_robot import built, description_text
from ccr_host.control.adaptive.chain_space import ChainParameters, ChainSpace
from ccr_host.control.adaptive.chain_statics import ChainPose, ChainStatics
from ccr_host.control.adaptive.identification import StaticsFit, identification_of
from ccr_host.control.adaptive.model import PLAIN, make_static_model
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.description import schema
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits

ROBOTS = ["single", "two-spatial", "three-spatial"]


def model_of(description: Description) -> tuple[ChainStatics, ChainSpace]:
    space = ChainSpace(description)
    return ChainStatics(description, space), space


def believable(space: ChainSpace, seed: int) -> np.ndarray:
    """Scores of a robot whose tendons are not taut while it is straight."""
    score = 0.7 * np.random.default_rng(seed).standard_normal(space.count)
    slack = [number for number, u in enumerate(space.model.unknowns) if u.kind == "slack"]
    score[slack] = np.abs(score[slack])
    return space.bounded(score)


def some_bending(space: ChainSpace, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.2, 1.2, len(space.model.freedom))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("robot", ROBOTS)
def test_setpoints_that_hold_a_pose_lead_there_through_slack_and_stretch(robot, seed):
    model, space = model_of(schema.load(robot))
    p = space.parameters(believable(space, seed))
    for number in range(4):
        theta_rad = some_bending(space, 10 * seed + number)
        pose = model.first_pose(p, model.unhindered_rad(p, theta_rad))
        assert pose.theta_rad == pytest.approx(theta_rad, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("robot", [None, "single", "two-spatial", "three-spatial"])
def test_a_pose_is_seen_whatever_bends_it_and_a_turned_camera_is_left(robot, seed):
    model, space = make_static_model(schema.load(robot))
    rng = np.random.default_rng(seed)
    p = space.parameters(space.bounded(0.5 * rng.standard_normal(space.count)))
    freedom = 2 if robot is None else len(space.model.freedom)
    theta_rad = rng.uniform(0.4, 1.2, freedom)
    seen_mm = model.markers_mm(p, theta_rad[None])[0]
    assert model.tip_mm(p, theta_rad) == pytest.approx(seen_mm[-1])
    near_rad = theta_rad + rng.uniform(-0.2, 0.2, freedom)
    found_rad, left_mm, by_markers = model.seen_pose(p, near_rad, seen_mm)
    assert found_rad == pytest.approx(theta_rad, abs=0.02)
    assert np.abs(left_mm).max() < 0.1
    farther_mm = model.markers_mm(p, theta_rad[None] + 1e-4)[0] - seen_mm
    assert by_markers @ farther_mm.ravel() == pytest.approx(1e-4, rel=0.1)
    turned_mm = seen_mm @ Rotation.from_rotvec([0, 0, 10], degrees=True).as_matrix().T
    assert np.linalg.norm(model.seen_pose(p, theta_rad, turned_mm).left_mm) > 1.0
    without = seen_mm.copy()
    without[:-1] = np.nan
    left_mm = model.seen_pose(p, near_rad, without).left_mm
    assert np.array_equal(np.isnan(left_mm), np.isnan(without))


@pytest.mark.parametrize("robot", ROBOTS)
def test_backlash_is_taken_up_but_for_reversals_of_a_tenth_of_a_degree(robot):
    model, space = model_of(schema.load(robot))
    p, motors = space.parameters(believable(space, 2)), space.winding_mm.shape[1]
    assert p.half_dead_mm.max() > 0.05
    pose, free = model.first_pose(p, np.zeros(motors)), (0.0,) * motors
    for number in range(6):
        theta_rad = some_bending(space, number)
        hold = model.hold(p, pose, theta_rad, free, free)
        pose = model.moved(p, pose, 0.0, hold.setpoint_rad)
        assert pose.theta_rad == pytest.approx(theta_rad, abs=0.01)


@pytest.mark.parametrize("robot", ["two-spatial", "three-spatial"])
def test_no_tendon_of_a_motor_of_its_own_pulls_more_than_the_pose_needs(robot):
    """One of the three tendons of a segment is just taut: there is no pretension."""
    model, space = model_of(schema.load(robot))
    p = space.parameters(np.zeros(space.count))
    for seed in range(5):
        q_rad = model.unhindered_rad(p, some_bending(space, seed))
        stretch_mm = p.rest.stretch_mm(some_bending(space, seed), space.winding_mm @ q_rad)
        for segment in range(len(p.rest.lengths_mm)):
            assert stretch_mm[space.model.segment_of == segment].min() < 1e-3


@pytest.mark.parametrize("seed", [1, 2])
def test_no_motor_makes_the_others_pull_much_more_than_with_its_other_tendon(seed, tmp_path):
    """A robot of three segments and eight motors, tendons up to 20 deg off their directions."""
    file = tmp_path / "robot.toml"
    file.write_text(description_text(built(np.random.default_rng(78), 3)))
    model, space = model_of(schema.load(str(file)))
    p, rng = space.parameters(believable(space, seed)), np.random.default_rng(seed)
    levers_mm = np.abs(p.rest.lever_mm).max(axis=(1, 2))

    def pull(theta_rad, hold):
        travel_mm = space.winding_mm @ hold.setpoint_rad
        stretch_mm = np.maximum(p.rest.stretch_mm(theta_rad, travel_mm), 0.0)
        return (stretch_mm * p.rest.tendon_stiffness_mm2 * levers_mm).max()

    motors, kept = space.winding_mm.shape[1], 0
    for _ in range(60):
        theta_rad = rng.uniform(-0.8, 0.8, len(space.model.freedom))
        pose = model.first_pose(p, 0.2 * rng.normal(size=motors))
        sides = tuple(rng.choice([-1.0, 1.0], motors).tolist())
        free = model.hold(p, pose, theta_rad, (0.0,) * motors, (0.0,) * motors)
        hold = model.hold(p, pose, theta_rad, sides, (0.04,) * motors)
        kept += hold.sides != free.sides
        for motor in range(motors):
            other = tuple(-side if i == motor else side for i, side in enumerate(hold.sides))
            forced = model.hold(p, pose, theta_rad, other, (1e9,) * motors)
            assert pull(theta_rad, hold) <= 2.0 * pull(theta_rad, forced) + 0.1
    assert kept


@pytest.mark.parametrize("robot", ROBOTS)
def test_sensitivity_is_the_slope_of_the_tip_at_rest(robot):
    model, space = model_of(schema.load(robot))
    score, q_rad = believable(space, 1), np.full(space.winding_mm.shape[1], 0.4)
    score[space.roles.hindrances] = 0.5
    p = space.parameters(score)
    slid_mm = 0.03 * np.resize([1.0, 0.2, -1.0, -0.1], len(space.winding_mm))
    near_rad = model.first_pose(p, q_rad).theta_rad

    def rest_of(p: ChainParameters, q_rad: np.ndarray, anchor_mm: np.ndarray) -> np.ndarray:
        travel_mm = (space.winding_mm @ q_rad)[None]
        return p.rest.rest(travel_mm, near_rad[None], anchor_mm=anchor_mm[None])[0]

    for _ in range(20):  # To where some tendons stick and others slide on.
        anchor_mm = p.rest.route_mm(near_rad) - slid_mm
        near_rad = rest_of(p, q_rad, anchor_mm)
    pose = ChainPose(q_rad, space.winding_mm @ q_rad, anchor_mm, near_rad)
    numbers = sorted({*space.roles.drifting, *space.roles.loads, *space.roles.hindrances})
    found = model.sensitivity(space, score, numbers, p, pose, np.ones_like(q_rad))
    there_mm = p.rest.route_mm(near_rad)

    def tip_mm(score: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
        p = space.parameters(score)
        moved_mm = p.rest.route_mm(near_rad) - there_mm
        return model.tip_mm(p, rest_of(p, q_rad, anchor_mm + moved_mm))

    step = 1e-4
    for column, number in enumerate(numbers):
        way = step * (np.arange(space.count) == number)
        slope = (tip_mm(score + way, q_rad) - tip_mm(score - way, q_rad)) / (2.0 * step)
        assert found.tip[:, column] == pytest.approx(slope, abs=1e-3)
    slope = (tip_mm(score, q_rad + step) - tip_mm(score, q_rad - step)) / (2.0 * step)
    assert found.tip[:, -1] == pytest.approx(slope, abs=1e-2)


def soft_and_loose(space: ChainSpace, seed: int) -> np.ndarray:
    """Tens of mm from the prior: threads in place of steel wire, with slack."""
    score = believable(space, seed)
    for number, unknown in enumerate(space.model.unknowns):
        if unknown.kind in ("log_compliance", "slack"):
            score[number] = {"log_compliance": 2.5, "slack": 1.2}[unknown.kind]
    return score


def seen_tour(description: Description, truth: ChainParameters) -> Rests:
    """The rests of a tour as a camera with 0.1 mm of noise sees them."""
    model, space = model_of(description)
    prior = space.parameters(np.zeros(space.count))
    stops_rad = model.tour_rad(prior, MotorLimits.of(description.servo))
    count = np.full(len(stops_rad), 6.0)
    rests = Rests.in_turn(np.zeros_like(stops_rad[0]), stops_rad, np.empty(0), count)
    exact_mm = model.predicted_mm(truth, rests)
    seen_mm = exact_mm + np.random.default_rng(1).normal(scale=0.1, size=exact_mm.shape)
    return Rests.of_vectors(rests.from_rad, stops_rad, seen_mm, count)


@pytest.mark.long
@pytest.mark.parametrize("true_score", [believable, soft_and_loose])
@pytest.mark.parametrize("robot", ["single", "two-spatial"])
def test_a_tour_of_another_robot_is_fitted_to_the_noise(robot, true_score):
    description = schema.load(robot)
    model, space = model_of(description)
    truth = space.parameters(true_score(space, 5))
    rests = seen_tour(description, truth)
    fits = identification_of(space, rests, model)
    assert fits is not None
    found = fits.finish().result()
    off_mm = model.predicted_mm(space.parameters(found.score), rests)
    off_mm -= model.predicted_mm(truth, rests)
    assert found.explains
    assert np.linalg.norm(off_mm, axis=-1).mean() < 0.25


@pytest.mark.long
def test_a_fit_is_also_started_elsewhere_and_the_likelier_one_counts(tmp_path):
    """The fit to this robot of one segment ends in a kink if it starts from the prior."""
    file = tmp_path / "robot.toml"
    file.write_text(description_text(built(np.random.default_rng(102), 1)))
    description = schema.load(str(file))
    model, space = model_of(description)
    rests = seen_tour(description, space.parameters(soft_and_loose(space, 102)))
    from_prior = StaticsFit(space, rests, model).finish()
    fits = identification_of(space, rests, model)
    assert fits is not None
    found = fits.finish().result()
    assert found.cost < from_prior.cost - 3.0
    assert found.rms_mm < 0.8 * from_prior.rms_mm


def test_a_hidden_end_leaves_the_segments_beside_it_less_well_known():
    description = schema.load("three-spatial")
    model, space = model_of(description)
    rests = seen_tour(description, space.parameters(believable(space, 1)))
    lengths = [name.startswith("length") for name in space.names]

    def variances(seen: Rests) -> np.ndarray:
        return np.diag(StaticsFit(space, seen, model).result().covariance)[lengths]

    hidden = replace(rests, markers_mm=rests.markers_mm.copy())
    hidden.markers_mm[:, 2] = np.nan
    assert (variances(hidden)[1:] > 2.0 * variances(rests)[1:]).all()
    assert variances(hidden)[0] > variances(rests)[0]


@pytest.mark.parametrize("robot", ROBOTS)
def test_slopes_by_the_scores_count_what_tendons_that_stick_remember(robot):
    """Predictions of perturbed robots agree with those of each such robot alone."""
    description = schema.load(robot)
    model, space = model_of(description)
    score = believable(space, 1)
    score[space.roles.hindrances] = 0.5
    stops_rad = np.random.default_rng(4).uniform(-0.5, 0.5, (8, space.winding_mm.shape[1]))
    stops_rad[4:6] = stops_rad[3] + [[0.004], [0.002]]  # Tendons stick on these short ways.
    rests = Rests.in_turn(0.0 * stops_rad[0], stops_rad, np.empty(0), np.ones(8))
    _, anchors_mm = space.parameters(score).rest.rests_in_turn(stops_rad @ space.winding_mm.T)
    assert (np.abs(np.diff(anchors_mm[3:6], axis=0)) < 1e-6).any()
    step, smooth = 1e-5, 0
    near_mm = model.predicted_mm(space.perturbed(score, step), rests)
    for number in range(space.count):
        way = step * (np.arange(space.count) == number)
        ahead, behind = (
            model.predicted_mm(space.parameters(score + sign * way), rests) for sign in (1, -1)
        )
        slope = (near_mm[:, number] - near_mm[:, -1]) / step
        agrees = np.abs(slope - (ahead - behind) / (2.0 * step)) < 0.02 * np.abs(slope).max() + 2e-3
        smooth += agrees.all()
    # A tendon may begin to slide, or become taut, within a step.
    assert smooth >= 0.9 * space.count


def test_what_friction_holds_is_found_and_holds_the_robot_back_along_a_path():
    description = schema.load("two-spatial")
    model, space = model_of(description)
    score = np.zeros(space.count)
    (friction,) = space.roles.hindrances
    score[friction] = 1.0
    truth = space.parameters(score)
    fit = StaticsFit(space, seen_tour(description, truth), model).finish()
    assert fit.rms_mm < 0.2
    assert 0.3 < fit.score[friction] < 1.2  # Dead travel takes the rest.
    theta_rad = some_bending(space, 1)
    start = model.first_pose(truth, model.unhindered_rad(truth, theta_rad))
    stuck = model.moved(truth, start, 0.0, start.setpoint_rad + 0.002)
    assert np.abs(stuck.theta_rad - start.theta_rad).max() < 1e-3
    free = (0.0,) * len(start.setpoint_rad)
    for goal_rad in (theta_rad + 0.1, theta_rad - 0.1, theta_rad):
        hold = model.hold(truth, start, goal_rad, free, free)
        start = model.moved(truth, start, 0.0, hold.setpoint_rad)
        assert start.theta_rad == pytest.approx(goal_rad, abs=0.01)


def test_the_papers_robot_rests_where_its_own_model_says_wherever_both_apply():
    """Without what only that model knows: weight, sag, friction, uneven bending."""
    paper = Robot()
    plain = Scaling(paper).parameters(np.zeros(COUNT))
    nothing = ("body_per_mm", "tip_per_mm", "sag_1", "sag_2")
    plain = plain._replace(**dict.fromkeys(nothing, 0.0), compliance_1=0.2, compliance_2=0.1)
    robot = Robot(segments=paper.chain, marker_offset_mm=15.0, pulley_radius_mm=12.5)
    model, space = model_of(Description(robot=robot))
    slack_mm = plain.slack_1_rad * paper.pulley_radius_mm
    p = space.parameters(np.zeros(space.count))
    r_mm2 = paper.tendon_radius_mm**2
    rest = replace(
        p.rest,
        sag_mm=np.zeros_like(p.rest.sag_mm),
        load_mm=np.zeros(3),
        slack_mm=np.full(4, slack_mm),
        tendon_stiffness_mm2=1.0 / (np.array([0.2, 0.2, 0.1, 0.1]) * r_mm2),
    )
    p = replace(p, rest=rest)
    for q_rad in np.random.default_rng(2).uniform(-1.0, 1.0, (20, 2)):
        general = model.first_pose(p, q_rad).theta_rad
        special = PLAIN.first_pose(plain, q_rad).theta_rad
        assert general == pytest.approx(special, abs=1e-6)
        expected_mm = PLAIN.tip_mm(plain, special)
        assert model.tip_mm(p, general) == pytest.approx(expected_mm, abs=1e-5)
