"""Camera, directions and zeros of robots of any kind, from one survey."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.misfit import MisfitError
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Motors, Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools import survey_starts
from ccr_host.tools.survey import identification_stops_rad, survey, survey_rests
from ccr_host.tools.survey_fit import Survey, fit_survey, require_motion_so_far
from ccr_host.tools.survey_starts import SurveyError, likeliest_motors, safe_poses_rad

NAMES = "single", "two-spatial", "three-spatial"
NOISE_MM = 0.05
"""Noise of a mean of thirty exposures."""


@cache
def description_of(name: str) -> schema.Description:
    return schema.load(name)


def rests_of(
    name: str, seed: int, motors: Motors | None = None, *, only_moves=False, spread=0.5
) -> Rests:
    """Rests of a robot off its prior, with zeros, as a camera anywhere sees them."""
    rng = np.random.default_rng(seed)
    description = description_of(name)
    model, space = make_static_model(description, is_new=True)
    motors = motors or Motors.as_described(description.robot.motors)
    safe_rad = safe_poses_rad(description)
    tour_rad = identification_stops_rad(description)
    q_rad = safe_rad if only_moves else np.concatenate([safe_rad, tour_rad]) * motors.signs
    nothing = np.zeros((len(q_rad), len(description.robot.markers), 3))
    rests = Rests.in_turn(np.zeros(q_rad.shape[1]), q_rad, nothing, np.full(len(q_rad), 30.0))
    seen_mm = model.predicted_mm(
        space.parameters(true_score(name, seed, spread)), motors.drive(rests)
    )
    seen_mm = seen_mm + rng.normal(0.0, NOISE_MM, seen_mm.shape)
    turn = Rotation.random(random_state=seed).as_matrix()
    return Rests.of_vectors(rests.from_rad, q_rad, seen_mm, rests.count).turned(turn.T)


@cache
def true_score(name: str, seed: int, spread: float) -> np.ndarray:
    """Scores of a robot within its prior, but for zeros up to 10 deg off."""
    rng = np.random.default_rng(seed)
    _, space = make_static_model(description_of(name), is_new=True)
    score = np.clip(rng.normal(0.0, spread, space.count), -1.0, 1.0)
    score[space.roles.turns] = 0.0
    zeros = [number for number, key in enumerate(space.names) if key.startswith("zero_")]
    score[zeros] = rng.uniform(-1.0, 1.0, len(zeros)) / 3.0
    return score


def reversed_in(name: str, *reversed_motors: int) -> Motors:
    motors = Motors.as_described(description_of(name).robot.motors)
    signs = (-1.0 if m + 1 in reversed_motors else s for m, s in enumerate(motors.signs))
    return motors._replace(signs=tuple(signs))


def off_deg(found: Survey, true: Rotation) -> np.ndarray:
    return (Rotation.from_matrix(found.camera_to_robot) * true.inv()).as_rotvec(degrees=True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "wrong", "spread"),
    [
        ("single", (1,), 0.5),
        ("two-spatial", (2, 3), 0.5),
        ("three-spatial", (4, 5, 9), 0.5),
    ],
)
def test_camera_directions_and_zeros_are_found_as_exactly_as_stated(
    name: str, wrong: tuple[int, ...], spread: float
) -> None:
    motors = reversed_in(name, *wrong)
    found = fit_survey(rests_of(name, 1, motors, spread=spread), description_of(name))
    assert found.reversed_motors == wrong
    true = Rotation.random(random_state=1)
    assert (np.abs(off_deg(found, true)) < 2.5 * found.uncertainty_deg).all()
    _, space = make_static_model(description_of(name), is_new=True)
    zeros_off_rad = found.neutral_rad * motors.signs - space.zero_rad @ true_score(name, 1, spread)
    assert (np.abs(zeros_off_rad) < 2.5 * found.neutral_deviation_rad).all()


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("single", ()), ("two-spatial", (1, 2, 3, 4)), ("two-spatial", (4,))],
)
def test_small_moves_tell_which_motors_are_reversed(name: str, wrong) -> None:
    motors = reversed_in(name, *wrong)
    found = likeliest_motors(rests_of(name, 2, motors, only_moves=True), description_of(name))
    assert found == motors


def test_reversed_motors_of_single_tendons_are_not_taken_for_exchanged_ones() -> None:
    description = description_of("three-spatial")
    seen_mm = np.loadtxt(Path(__file__).parent / "moves_of_three_spatial.csv", delimiter=",")
    motors = reversed_in("three-spatial", 3, 4, 5, 6)
    q_rad = safe_poses_rad(description) * motors.signs
    markers_mm = seen_mm.reshape(len(q_rad), -1, 3)
    rests = Rests.in_turn(np.zeros(9), q_rad, markers_mm, np.full(len(q_rad), 30.0))
    assert likeliest_motors(rests, description) == motors


def test_fits_tell_which_motors_are_reversed_where_distances_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(survey_starts, "_DISTINCT", 10.0)
    motors = reversed_in("single", 1)
    rests = rests_of("single", 2, motors, only_moves=True)
    assert likeliest_motors(rests, description_of("single")) == motors


def test_fits_that_explain_nothing_do_not_tell_which_motors_are_reversed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(survey_starts, "_DISTINCT", 10.0)
    rests = rests_of("single", 2, only_moves=True)
    off_mm = np.random.default_rng(1).normal(0.0, 10.0, rests.vectors_mm.shape)
    shaken = Rests.of_vectors(rests.from_rad, rests.q_rad, rests.vectors_mm + off_mm, rests.count)
    with pytest.raises(SurveyError, match="do not tell"):
        likeliest_motors(shaken, description_of("single"))


def test_small_moves_tell_exchanged_motors() -> None:
    motors = Motors((1.0,) * 4, (2, 1, 0, 3))
    rests = rests_of("two-spatial", 3, motors, only_moves=True)
    with pytest.raises(MisfitError, match="motors 1 and 3 are exchanged"):
        likeliest_motors(rests, description_of("two-spatial"))


@pytest.mark.parametrize(
    ("name", "least_rad"), [("single", 0.5), ("two-spatial", 0.5), ("three-spatial", 0.34)]
)
def test_poses_stay_within_the_limits_and_move_each_motor_to_both_sides_without_pretension(
    name: str, least_rad: float
) -> None:
    limits = MotorLimits.of(description_of(name).servo)
    poses_rad = safe_poses_rad(description_of(name))
    assert (poses_rad >= limits.lower_rad).all()
    assert (poses_rad <= limits.upper_rad).all()
    assert (poses_rad.max(axis=0) > least_rad).all()
    assert (poses_rad.min(axis=0) < -least_rad).all()
    bending = ConstantCurvature(description_of(name).robot).bending_rad(np.eye(poses_rad.shape[1]))
    np.testing.assert_allclose(poses_rad, poses_rad @ bending @ np.linalg.pinv(bending), atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_small_moves_tell_the_hysteresis_of_each_motor(name: str) -> None:
    assert np.isfinite(rests_of(name, 1, only_moves=True).hysteresis_mm()).all()


def led_by_the_model(motors: Motors, monkeypatch) -> list[np.ndarray]:
    """The stops that a survey visits on ``three-spatial``, whose prior answers from now on."""
    model, space = make_static_model(description_of("three-spatial"), is_new=True)
    p, visited = space.parameters(np.zeros(space.count)), []

    def visit(_, __, stops_rad, on_pose, **___) -> Rests:
        visited.append(stops_rad)
        on_pose(len(stops_rad), len(stops_rad))
        nothing = np.zeros((len(stops_rad), 4, 3))
        count = np.full(len(stops_rad), 30.0)
        led = motors.drive(Rests.in_turn(stops_rad[0], stops_rad, nothing, count))
        return Rests.of_vectors(stops_rad, stops_rad, model.predicted_mm(p, led), count)

    monkeypatch.setattr("ccr_host.tools.survey.visit", visit)
    return visited


@pytest.mark.parametrize("idle", [1, 9])
def test_a_motor_that_pulls_nothing_is_named_though_others_move_the_robot(
    idle: int, monkeypatch
) -> None:
    motors = reversed_in("three-spatial", 2)
    signs = tuple(sign * (number + 1 != idle) for number, sign in enumerate(motors.signs))
    led_by_the_model(motors._replace(signs=signs), monkeypatch)
    with pytest.raises(SurveyError, match=f"motor {idle} hardly moves the robot"):
        survey_rests(None, description_of("three-spatial"), lambda *_: None)


def test_small_moves_are_repeated_in_the_directions_found_until_these_stay(monkeypatch) -> None:
    motors, told = reversed_in("three-spatial", 2, 9), []
    visited = led_by_the_model(motors, monkeypatch)
    description = description_of("three-spatial")
    rests = survey_rests(None, description, lambda *progress: told.append(progress))
    safe_rad, tour_rad = safe_poses_rad(description), identification_stops_rad(description)
    first, again, tour = visited
    np.testing.assert_array_equal(first, safe_rad)
    np.testing.assert_array_equal(again, safe_rad * motors.signs)
    np.testing.assert_allclose(tour, 0.5 * tour_rad * motors.signs)
    assert told == [(37, 73), (74, 110), (110, 110)]
    np.testing.assert_array_equal(rests.q_rad, np.concatenate([again, tour]))


def test_a_robot_that_is_held_is_refused() -> None:
    rests = rests_of("two-spatial", 1, only_moves=True)
    held = replace(rests, markers_mm=np.repeat(rests.markers_mm[:1], len(rests.q_rad), axis=0))
    with pytest.raises(SurveyError, match=r"motor 1 moved M3 by 0\.0 mm only"):
        fit_survey(held, description_of("two-spatial"))


@pytest.mark.long
@pytest.mark.parametrize("name", ["single", "two-spatial"])
def test_a_camera_that_stands_anyhow_is_found_on_the_twin(name: str) -> None:
    options = RigOptions(robot=name, overrides=("tracker.rotation_deg=[10,-40,25]",))
    description = options.description()
    with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
        found = survey(rig, description, lambda *_: None)
    true = Rotation.from_rotvec([10.0, -40.0, 25.0], degrees=True)
    assert (np.abs(off_deg(found, true)) < 2.5 * found.uncertainty_deg).all()


@pytest.mark.parametrize("still", [2, 4])
def test_a_motor_that_moves_nothing_is_named_however_the_others_bend_the_robot(still) -> None:
    description = description_of("two-spatial")
    safe_rad = safe_poses_rad(description)
    model = ConstantCurvature(description.robot)
    led_rad = safe_rad * (np.arange(1, model.motors + 1) != still)
    markers_mm = model.markers_mm(model.bending_rad(led_rad))[0]
    rests = Rests.of_vectors(safe_rad, safe_rad, markers_mm, np.ones(len(safe_rad)))
    with pytest.raises(SurveyError, match=f"motor {still} moved M3 by 0.0 mm only"):
        require_motion_so_far(rests, description, len(safe_rad), safe_rad)
