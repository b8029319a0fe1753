import functools
from dataclasses import replace

import numpy as np
import pytest

from ccr_host.control.adaptive.estimator import Estimator
from ccr_host.control.adaptive.identification import StaticsFit, identification_of
from ccr_host.control.adaptive.model import PLAIN, tour_bending_rad
from ccr_host.control.adaptive.motion import first_pose, moved, predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, TURNS, Parameters, Scaling
from ccr_host.control.adaptive.static_model import PoseFollower
from ccr_host.control.adaptive.statics import (
    settled,
    shafts_of,
    strains_of,
    unhindered_setpoints_for,
)
from ccr_host.control.adaptive.tip import tip_mm
from ccr_host.control.shell import smooth_moves
from ccr_host.description.schema import Robot
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory

SCALING = Scaling(Robot())
PRIOR = SCALING.parameters(np.zeros(COUNT))
SHIFT_MM = np.array([0.0, 1.0, 3.0])
HERE = np.array([0.2, 0.4])
STILL = np.zeros(2)


def _tour_of(p, noise_mm=0.0, seed=1, count=6.0, apart_s=np.nan):
    stops = unhindered_setpoints_for(PRIOR, tour_bending_rad())
    unseen, counts = np.zeros((len(stops), 3, 3)), np.full(len(stops), count)
    rests = Rests.in_turn(STILL, stops, unseen, counts)
    rests = replace(rests, time_s=apart_s * np.arange(len(stops)))
    tips = predicted_mm(p, rests)
    noise = noise_mm / np.sqrt(count) * np.random.default_rng(seed).standard_normal(tips.shape)
    return Rests.of_vectors(rests.from_rad, stops, tips + noise, counts, rests.time_s)


def _believable(seed):
    score = SCALING.bounded(0.7 * np.random.default_rng(seed).standard_normal(COUNT))
    score[[Parameters._fields.index(name) for name in ("push_x_per_mm", "push_y_per_mm")]] = 0.0
    return SCALING.parameters(score)


def _tips_elsewhere(p):
    pose, tips = first_pose(p, 0.0, 0.0), []
    for setpoint in np.radians([[15.0, 33.0], [-20.0, -25.0], [24.0, -30.0]]):
        pose = moved(p, pose, *setpoint)
        tips.append(tip_mm(p, *pose.theta_rad))
    return np.array(tips)


@pytest.mark.long
def test_the_tour_tells_all_parameters_well_enough_to_predict_other_taut_poses(compiled):
    truth = _believable(1)
    found = SCALING.parameters(StaticsFit(SCALING, _tour_of(truth, 0.15), compiled).finish().score)
    assert _tips_elsewhere(found) == pytest.approx(_tips_elsewhere(truth), abs=0.5)


@pytest.mark.parametrize(
    ("beyond", "most_left_mm"),
    [
        ({"sag_1": 0.3}, 2.0),
        ({"slack_2_rad": -0.1}, 0.5),
        ({"zero_1_rad": 0.4}, 1.0),
        ({"taper_1": 0.9}, 0.3),
    ],
)
def test_a_robot_beyond_a_bound_is_fitted_as_well_as_the_bound_allows(
    compiled, beyond, most_left_mm
):
    """A step that counts on scores which the bound then takes back leads nowhere: it left 8, 2.3,
    5.3 and 0.6 mm."""
    tour = _tour_of(PRIOR._replace(**beyond))
    assert StaticsFit(SCALING, tour, compiled).finish().rms_mm < most_left_mm


@pytest.mark.long
def test_the_tour_tells_play_from_friction(compiled):
    truth = PRIOR._replace(backlash_rad=0.008, friction_1=0.22)
    found = SCALING.parameters(StaticsFit(SCALING, _tour_of(truth, 0.3), compiled).finish().score)
    assert found.backlash_rad == pytest.approx(0.008, abs=0.003)
    assert found.friction_1 == pytest.approx(0.22, abs=0.06)


@pytest.mark.long
def test_the_tour_tells_how_much_the_segments_creep(compiled):
    """Without times it tells nothing, and creep makes what the robot is not."""
    truth = PRIOR._replace(creep=0.06, turn_x_rad=0.01, friction_1=0.1)
    tour = _tour_of(truth, 0.15, apart_s=2.0)
    fit, untimed = (
        StaticsFit(SCALING, rests, compiled).finish()
        for rests in (tour, replace(tour, time_s=np.full(20, np.nan)))
    )
    found = SCALING.parameters(fit.score)
    assert found.creep == pytest.approx(0.06, abs=0.01)
    assert found.turn_x_rad == pytest.approx(0.01, abs=0.003)
    assert untimed.score[Parameters._fields.index("creep")] == 0.0
    assert untimed.rms_mm > 1.5 * fit.rms_mm


def _turn_found_deg(compiled, from_rad, stops):
    """The camera's turn found from rests of a robot that lags by a part of how far it is bent."""
    unseen = np.zeros((len(stops), 2, 3))
    rests = Rests.of_vectors(from_rad, stops, unseen, np.full(len(stops), 6.0))
    lagging = stops - 0.02 * np.abs(stops) * np.sign(stops - from_rad)
    seen_mm = predicted_mm(PRIOR, replace(rests, from_rad=lagging, q_rad=lagging))
    rests = Rests.of_vectors(from_rad, stops, seen_mm, rests.count)
    found = StaticsFit(SCALING, rests, compiled).finish()
    return np.degrees(SCALING.values(found.score)[TURNS]), found


@pytest.mark.long
def test_hysteresis_that_the_model_lacks_turns_no_camera_if_rests_are_reached_from_both_sides(
    compiled,
):
    rests_rad = unhindered_setpoints_for(PRIOR, tour_bending_rad())
    passed = PLAIN.passed_rad * np.tile((1.0, -1.0), len(rests_rad))[:, None]
    stops = rests_rad.repeat(2, axis=0)
    one_sided, _ = _turn_found_deg(compiled, np.vstack([STILL, rests_rad[:-1]]), rests_rad)
    both_sided, found = _turn_found_deg(compiled, stops + passed, stops)
    assert np.linalg.norm(both_sided) < 0.1
    assert np.linalg.norm(one_sided) > 0.2
    assert found.surprise < 0.5
    assert found.rms_mm < 0.1


@pytest.mark.long
def test_a_wild_rest_does_not_spoil_the_fit(compiled):
    rests = _tour_of(PRIOR)
    rests.markers_mm[7, 1:] += 30.0
    found = SCALING.parameters(StaticsFit(SCALING, rests, compiled).finish().score)
    assert np.median(np.linalg.norm(predicted_mm(found, rests) - rests.vectors_mm, axis=2)) < 0.3


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "is_narrow"),
    [
        ({}, True),
        ({"tip_per_mm": 0.004}, True),
        ({"taper_1": 0.3}, False),
        ({"twisting": 0.6}, False),
    ],
)
def test_the_prior_of_cheap_robots_is_taken_only_for_robots_with_their_faults(
    compiled, fault, is_narrow
):
    rests = _tour_of(PRIOR._replace(**fault), 0.3)
    found = identification_of(SCALING, rests, compiled)
    assert found is not None
    taper = Parameters._fields.index("taper_1")
    deviation = found.finish().scaling.deviation[taper]
    assert (deviation < SCALING.deviation[taper]) == is_narrow


@pytest.mark.long
@pytest.mark.parametrize("faults", [{}, {"taper_1": 0.3, "zero_1_rad": 0.05}])
@pytest.mark.parametrize(
    ("turn_deg", "is_aligned"),
    [((0.0, 0.0, 0.0), True), ((3.0, 0.0, 0.0), False), ((-1.0, 1.5, 1.0), False)],
)
def test_a_camera_is_taken_for_aligned_where_all_axes_together_strongly_suggest_it(
    compiled, faults, turn_deg, is_aligned
):
    turn = dict(zip(("turn_x_rad", "turn_y_rad", "turn_z_rad"), np.radians(turn_deg), strict=True))
    rests = _tour_of(PRIOR._replace(**turn, **faults), 0.3)
    found = identification_of(SCALING, rests, compiled)
    assert found is not None
    fit = found.finish()
    assert (fit.scaling.doubt > 0.0) == is_aligned
    turn_off = fit.scaling.values(fit.result().score)[TURNS] - np.radians(turn_deg)
    assert np.degrees(np.abs(turn_off)).max() < (0.1 if is_aligned else 1.5)


def test_only_a_camera_that_was_never_registered_may_turn_out_to_be_aligned():
    assert Scaling(Robot(), np.radians(0.3)).aligned() is None
    assert np.all(SCALING.aligned().deviation[TURNS] < np.radians(0.5))


@pytest.mark.long
def test_each_step_of_the_fit_leaves_less(compiled):
    fit, left_mm = StaticsFit(SCALING, _tour_of(_believable(3)), compiled), []
    while fit.improve():
        left_mm.append(fit.result().rms_mm)
    assert len(left_mm) > 2
    assert left_mm[-1] < 0.1 * left_mm[0]


def _resting(p, pose):
    shafts = shafts_of(p, pose[:2], pose[2:4])
    theta_1, theta_2 = settled(p, pose.theta_1, pose.theta_2, shafts, pose.anchors)
    return pose._replace(theta_1=theta_1, theta_2=theta_2)


def _resting_exactly(p, pose):
    """Everything well on its way of sliding, which derivatives on both sides need."""
    routes = strains_of(p, pose.theta_1, pose.theta_2)
    anchors = tuple(2.0 * a - route for a, route in zip(pose.anchors, routes, strict=True))
    pose = pose._replace(anchors=anchors)
    for _ in range(3):
        pose = _resting(p, pose)
    return pose


def test_sensitivity_is_the_derivative_of_the_rest_pose():
    score = np.full(COUNT, 0.3)
    p = SCALING.parameters(score)
    pose = _resting_exactly(p, moved(p, first_pose(p, 0.0, 0.0), 0.25, -0.6))
    rate = np.array([0.3, -0.2])
    found = PLAIN.sensitivity(SCALING, score, range(COUNT), p, pose, rate)
    for index, step in enumerate(3e-3 * np.eye(COUNT)):
        near = [SCALING.parameters(score + sign * step) for sign in (1.0, -1.0)]
        above, below = (tip_mm(q, *_resting(q, pose).theta_rad) for q in near)
        slope = (above - below) / 6e-3
        assert found.tip[:, index] == pytest.approx(slope, abs=5e-3), Parameters._fields[index]
    ahead = _resting(p, pose._replace(q_1=pose.q_1 + 3e-4, q_2=pose.q_2 - 2e-4))
    speed = (tip_mm(p, *ahead.theta_rad) - tip_mm(p, *pose.theta_rad)) / 1e-3
    assert found.tip[:, COUNT] == pytest.approx(speed, rel=0.02, abs=0.05)


@functools.cache
def _fit_to_the_prior():
    return StaticsFit(SCALING, _tour_of(PRIOR), PLAIN).finish()


def _estimator_at_rest():
    estimator = Estimator(PLAIN, SCALING, _fit_to_the_prior())
    return estimator, first_pose(estimator.parameters, *HERE)


def _corrected(estimator, pose, seen, jolt_rad=0.0):
    modelled = tip_mm(estimator.parameters, *pose.theta_rad)
    return estimator.correct(pose, modelled, STILL, jolt_rad, seen)


def test_a_sudden_offset_is_found_within_two_seconds_and_the_filter_stays_sound():
    estimator, pose = _estimator_at_rest()
    seen = tip_mm(estimator.parameters, *pose.theta_rad) + SHIFT_MM
    for _ in range(40):
        estimator.elapse(0.05)
        pose = _corrected(estimator, pose, seen)
    expected = tip_mm(estimator.parameters, *pose.theta_rad) + estimator.offset_mm
    assert expected == pytest.approx(seen, abs=0.3)


def test_what_a_fit_leaves_is_taken_for_the_models_error_rather_than_for_a_load():
    """Freed loads sent the tip of a robot that the model explained to 2.6 mm 90 mm off."""
    loads = []
    for rms_mm in (0.3, 2.6):
        estimator = Estimator(PLAIN, SCALING, replace(_fit_to_the_prior(), rms_mm=rms_mm))
        pose, before = first_pose(estimator.parameters, *HERE), estimator.parameters
        seen = tip_mm(estimator.parameters, *pose.theta_rad) + SHIFT_MM
        for _ in range(40):
            estimator.elapse(0.05)
            pose = _corrected(estimator, pose, seen)
        loads.append(abs(estimator.parameters.tip_per_mm - before.tip_per_mm))
    assert loads[1] < 0.5 * loads[0]
    assert estimator.offset_mm == pytest.approx(SHIFT_MM, abs=0.8)


def test_a_payload_hung_on_later_is_found_as_a_load_within_two_seconds():
    estimator, pose = _estimator_at_rest()
    true = estimator.parameters
    for _ in range(60):
        estimator.elapse(0.05)
        pose = _corrected(estimator, pose, tip_mm(true, *first_pose(true, *HERE).theta_rad))
    loaded = true._replace(tip_per_mm=true.tip_per_mm + 0.0025)
    seen = first_pose(loaded, *HERE)
    for setpoint in HERE + 0.1 * np.linspace(0.0, 1.0, 41)[1:, None]:
        estimator.elapse(0.05)
        seen = moved(loaded, seen, *setpoint)
        pose = moved(estimator.parameters, pose, *setpoint)
        pose = _corrected(estimator, pose, tip_mm(loaded, *seen.theta_rad))
    assert estimator.parameters.tip_per_mm - true.tip_per_mm > 0.0012


@pytest.mark.parametrize("lifted", [True, False])
def test_other_parameters_do_not_count_on_a_load_that_is_at_its_bound(lifted):
    """On robot 48 of `bench.any_robot`, half of a correction was taken back by the bound of the
    weight's share at the tip, and the rest of it led the model 7 mm away from the robot."""
    fit, load = _fit_to_the_prior(), Parameters._fields.index("tip_per_mm")
    at_bound = SCALING.bounded(np.where(np.arange(COUNT) == load, -1e3, fit.score))
    known = fit.covariance - np.outer(*2 * [fit.covariance[load]]) / fit.covariance[load, load]
    found = []
    for covariance in (fit.covariance, known):
        fitted = replace(fit, score=at_bound, covariance=covariance)
        estimator = Estimator(PLAIN, SCALING, fitted)
        pose = first_pose(estimator.parameters, *HERE)
        seen = tip_mm(estimator.parameters, *pose.theta_rad)
        estimator.elapse(0.05)
        pose = _corrected(estimator, pose, seen + np.array([0.0, 0.0, 1.0 if lifted else -1.0]))
        moved_rad = (pose.theta_1, pose.theta_2)
        found.append(np.concatenate([estimator.offset_mm, moved_rad, estimator.parameters]))
    assert (found[0] == pytest.approx(found[1], abs=1e-6)) is lifted


def test_the_zeros_of_servos_that_warm_up_are_followed():
    estimator, pose = _estimator_at_rest()
    true, seen, drift_rad = estimator.parameters, pose, np.radians((1.0, -1.0))
    for share in np.linspace(0.0, 1.0, 401)[1:]:
        warm = true._replace(zero_1_rad=share * drift_rad[0], zero_2_rad=share * drift_rad[1])
        setpoint = 0.7 * np.sin(40.0 * share + np.array([0.0, 1.0]))
        estimator.elapse(0.2)
        seen = moved(warm, seen, *setpoint)
        pose = moved(estimator.parameters, pose, *setpoint)
        pose = _corrected(estimator, pose, tip_mm(warm, *seen.theta_rad))
    found = estimator.parameters
    assert (found.zero_1_rad, found.zero_2_rad) == pytest.approx(drift_rad, rel=0.5)


def test_a_swing_after_a_jump_of_the_servos_teaches_next_to_nothing():
    estimator, pose = _estimator_at_rest()
    before = np.array(estimator.parameters)
    seen = tip_mm(estimator.parameters, *pose.theta_rad) + np.array([0.0, 5.0, 20.0])
    for _ in range(4):
        estimator.elapse(0.05)
        pose = _corrected(estimator, pose, seen, jolt_rad=0.3)
    assert np.array(estimator.parameters) == pytest.approx(before, rel=0.1, abs=1e-3)


def test_five_hundred_noisy_corrections_leave_the_filter_bounded():
    rng = np.random.default_rng(5)
    estimator, pose = _estimator_at_rest()
    seen = tip_mm(estimator.parameters, *pose.theta_rad)
    for _ in range(500):
        estimator.elapse(0.05)
        pose = _corrected(estimator, pose, seen + 0.2 * rng.standard_normal(3))
    assert np.abs(estimator.offset_mm).max() < 1.0


def test_commands_follow_the_estimate_slowly_enough_for_a_resonant_structure():
    """A swing at 6.7 Hz, seen at 20 Hz, must come back ten times smaller at least."""
    estimator, pose = _estimator_at_rest()
    seen, offsets = tip_mm(estimator.parameters, *pose.theta_rad), []
    for number in range(90):
        estimator.elapse(0.05)
        swing = np.array([0.0, 0.0, np.sin(2.0 * np.pi * number / 3.0)])
        pose = _corrected(estimator, pose, seen + swing)
        offsets.append(estimator.offset_mm[2])
    assert np.ptp(offsets[60:]) < 0.2


def test_following_a_history_in_pieces_or_at_once_comes_to_the_same_rest():
    p = PRIOR._replace(friction_1=0.2, backlash_rad=0.01)
    history = SetpointHistory(STILL)
    for number, q in enumerate([(0.2, 0.3), (0.1, 0.5), (0.15, 0.1)]):
        history.command(float(number), np.array(q), 0.5)
    pieces, once = PoseFollower(PLAIN, p, history, -1.0), PoseFollower(PLAIN, p, history, -1.0)
    for time_s in (0.1, 0.4, 1.7, 1.9, 2.2):
        pieces.advance_to(p, time_s)
    apart = pieces.advance_to(p, 4.0).theta_rad - once.advance_to(p, 4.0).theta_rad
    assert np.abs(apart).max() < 0.01


def test_the_tour_ends_each_move_at_its_stop_and_never_outruns_its_rate():
    stops = np.array([[0.5, -0.5], [0.0, 1.0]])
    setpoints = smooth_moves(STILL, stops, 0.5, 0.05)
    assert setpoints[-1] == pytest.approx(stops[-1])
    steps = np.abs(np.diff(np.vstack([STILL, setpoints]), axis=0)).max()
    assert steps <= np.radians(60.0) * 1.9 * 0.05
