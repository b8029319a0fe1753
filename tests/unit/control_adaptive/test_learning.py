import numpy as np
import pytest

from ccr_host.config import Robot
from ccr_host.control.adaptive.estimator import Estimator, Tuning
from ccr_host.control.adaptive.excitation import tour, tour_bending_rad
from ccr_host.control.adaptive.identification import Scaling, fit_statics, tip_sensitivity
from ccr_host.control.adaptive.setpoint_history import SetpointHistory
from ccr_host.control.adaptive.statics import (
    COUNT,
    Drive,
    Parameters,
    likely_bending_rad,
    rest_at,
    setpoints_for,
    tip_mm,
)

SCALING = Scaling(Robot())
SHIFT_MM = np.array([0.0, 1.0, 3.0])


def _rests(score, count, seed):
    rng = np.random.default_rng(seed)
    p = SCALING.parameters(score)
    stops = setpoints_for(p, tour_bending_rad(), np.zeros((20, 2)))
    drive = Drive(np.repeat(stops, count, axis=0), np.sign(rng.standard_normal((20 * count, 2))))
    theta = rest_at(p, drive, likely_bending_rad(p, drive.setpoint_rad))
    return drive, tip_mm(p, theta)


def test_the_tour_tells_all_parameters_well_enough_to_predict_other_taut_poses():
    rng = np.random.default_rng(1)
    truth = SCALING.bounded(0.7 * rng.standard_normal(COUNT))
    drive, clean_mm = _rests(truth, 6, 2)
    noisy_mm = clean_mm + 0.15 * rng.standard_normal(clean_mm.shape)
    found = SCALING.parameters(fit_statics(SCALING, drive, noisy_mm, 0.15).score)
    elsewhere = Drive(np.radians([[15.0, 33.0], [-20.0, -25.0], [24.0, -30.0]]), np.zeros((3, 2)))
    start = likely_bending_rad(found, elsewhere.setpoint_rad)
    true = SCALING.parameters(truth)
    expected = tip_mm(true, rest_at(true, elsewhere, start))
    predicted = tip_mm(found, rest_at(found, elsewhere, start))
    assert predicted == pytest.approx(expected, abs=0.3)


def test_a_few_wild_measurements_do_not_spoil_the_fit():
    drive, clean_mm = _rests(np.zeros(COUNT), 5, 3)
    spoiled = clean_mm.copy()
    spoiled[::17] += 30.0
    fit = fit_statics(SCALING, drive, spoiled, 0.3)
    p = SCALING.parameters(fit.score)
    theta = rest_at(p, drive, likely_bending_rad(p, drive.setpoint_rad))
    assert np.median(np.linalg.norm(tip_mm(p, theta) - clean_mm, axis=1)) < 0.3


def test_sensitivity_is_the_derivative_of_the_rest_pose():
    score = np.full(COUNT, 0.3)
    drive = Drive(np.array([0.25, -0.6]), np.array([1.0, -1.0]))
    p = SCALING.parameters(score)
    theta = rest_at(p, drive, likely_bending_rad(p, drive.setpoint_rad))
    slope = tip_sensitivity(SCALING, score, theta, drive)
    for index, step in enumerate(3e-3 * np.eye(COUNT)):
        above, below = SCALING.parameters(score + step), SCALING.parameters(score - step)
        moved = tip_mm(above, rest_at(above, drive, theta)) - tip_mm(
            below, rest_at(below, drive, theta)
        )
        assert slope[:, index] == pytest.approx(moved / 6e-3, abs=5e-3), Parameters._fields[index]


def test_a_sudden_offset_is_found_within_two_seconds_and_the_filter_stays_sound():
    drive, clean_mm = _rests(np.zeros(COUNT), 6, 4)
    estimator = Estimator(SCALING, fit_statics(SCALING, drive, clean_mm, 0.3), Tuning())
    here = Drive(np.array([0.2, 0.4]), np.zeros(2))
    p = SCALING.parameters(np.zeros(COUNT))
    seen = tip_mm(p, rest_at(p, here, likely_bending_rad(p, here.setpoint_rad)))
    for _ in range(40):
        estimator.elapse(0.05)
        estimator.correct(here, np.zeros(2), seen + SHIFT_MM)
    q = estimator.parameters
    expected = tip_mm(q, rest_at(q, here, likely_bending_rad(q, here.setpoint_rad)))
    assert expected + estimator.offset_mm == pytest.approx(seen + SHIFT_MM, abs=0.3)


def test_two_thousand_noisy_corrections_leave_the_filter_bounded():
    rng = np.random.default_rng(5)
    drive, clean_mm = _rests(np.zeros(COUNT), 6, 4)
    estimator = Estimator(SCALING, fit_statics(SCALING, drive, clean_mm, 0.3), Tuning())
    here = Drive(np.array([0.2, 0.4]), np.zeros(2))
    p = SCALING.parameters(np.zeros(COUNT))
    seen = tip_mm(p, rest_at(p, here, likely_bending_rad(p, here.setpoint_rad)))
    for _ in range(2000):
        estimator.elapse(0.05)
        estimator.correct(here, np.zeros(2), seen + 0.2 * rng.standard_normal(3))
    assert np.abs(estimator.offset_mm).max() < 1.0


def test_history_follows_ramps_and_knows_when_the_robot_stood():
    history = SetpointHistory(np.zeros(2))
    history.command(1.0, np.array([0.1, 0.0]), 0.5)
    drive, rate = history.at(1.25)
    assert drive.setpoint_rad == pytest.approx([0.05, 0.0])
    assert rate == pytest.approx([0.2, 0.0])
    assert drive.side == pytest.approx([1.0, 0.0])
    history.command(2.0, np.array([0.1, 0.0]), 0.5)
    assert history.resting_since(2.4) == pytest.approx(1.5)
    assert history.resting_since(1.2) == pytest.approx(1.2)


def test_a_command_during_a_ramp_goes_on_from_where_the_setpoint_is():
    history = SetpointHistory(np.zeros(2))
    history.command(0.0, np.array([1.0, 0.0]), 1.0)
    history.command(0.5, np.array([0.0, 0.0]), 1.0)
    assert history.at(1.0)[0].setpoint_rad == pytest.approx([0.25, 0.0])


def test_the_tour_ends_each_move_at_its_stop_and_never_outruns_its_rate():
    stops = np.array([[0.5, -0.5], [0.0, 1.0]])
    setpoints = tour(np.zeros(2), stops, 0.5, 0.05)
    assert setpoints[-1] == pytest.approx(stops[-1])
    steps = np.abs(np.diff(np.vstack([np.zeros(2), setpoints]), axis=0)).max()
    assert steps <= np.radians(60.0) * 1.9 * 0.05
