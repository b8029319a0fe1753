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
from ccr_host.tools.survey import identification_stops_rad, safe_poses_rad, survey
from ccr_host.tools.survey_fit import Survey, fit_survey, require_motion_so_far
from ccr_host.tools.survey_starts import SurveyError, likeliest_motors

NAMES = "single", "two-spatial", "three-spatial"
NOISE_MM = 0.05
"""Of a mean of thirty exposures."""


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
    tour_rad = identification_stops_rad(description) * motors.signs
    q_rad = safe_rad if only_moves else np.concatenate([safe_rad, tour_rad])
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
    q_rad = safe_poses_rad(description)
    markers_mm = seen_mm.reshape(len(q_rad), -1, 3)
    rests = Rests.in_turn(np.zeros(9), q_rad, markers_mm, np.full(len(q_rad), 30.0))
    found = likeliest_motors(rests, description)
    assert found == reversed_in("three-spatial", 1, 2, 4, 7, 9)


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


@pytest.mark.parametrize("name", NAMES)
def test_poses_stay_within_the_limits_and_move_each_motor_alone_to_both_sides(name: str) -> None:
    limits = MotorLimits.of(description_of(name).servo)
    poses_rad = safe_poses_rad(description_of(name))
    assert (poses_rad >= limits.lower_rad).all()
    assert (poses_rad <= limits.upper_rad).all()
    assert (np.count_nonzero(poses_rad, axis=1) <= 1).all()
    assert (poses_rad.max(axis=0) > 0.4).all()
    assert (poses_rad.min(axis=0) < -0.4).all()


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
