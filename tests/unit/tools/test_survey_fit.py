"""Camera, servos and tendons, from rests of the fit's own model seen by a turned camera."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.misfit import MisfitError
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.description import schema
from ccr_host.description.schema import Robot, Servo
from ccr_host.robot.rests import Motors, Rests
from ccr_host.tools.survey import (
    corrected,
    identification_stops_rad,
    recalibrated,
)
from ccr_host.tools.survey_fit import Survey, fit_survey, require_motion_so_far
from ccr_host.tools.survey_starts import SurveyError, safe_poses_rad

DESCRIPTION = schema.load(None, ["control.solver=compiled"])
ROBOT = Robot()
ASKEW = (1.2, -0.7, 2.0)


@cache
def stops_rad() -> np.ndarray:
    """Made when a test asks, as the first use of the compiled model takes seconds."""
    return np.concatenate([safe_poses_rad(DESCRIPTION), identification_stops_rad(DESCRIPTION)])


def seen(
    turn=(0.0, 0.0, 0.0), *, signs=(1.0, 1.0), swapped=False, robot=ROBOT, **parameters: float
) -> Rests:
    """Rests of a robot with these parameters, as a camera turned by a rotation vector sees them."""
    p = Scaling(robot).parameters(np.zeros(COUNT))._replace(**parameters)
    stops = stops_rad()
    count = np.full(len(stops), 30.0)
    commanded = Rests.in_turn(np.zeros(2), stops, np.zeros((len(stops), 3, 3)), count)
    motors = Motors(signs, (1, 0) if swapped else (0, 1))
    vectors_mm = predicted_mm(p, motors.drive(commanded))
    rests = Rests.of_vectors(commanded.from_rad, stops, vectors_mm, count)
    return rests.turned(Rotation.from_rotvec(turn).as_matrix().T)


def off_deg(found: Survey, turn: tuple[float, ...]) -> np.ndarray:
    """Error of the camera's rotation about x, y and z of the robot."""
    error = Rotation.from_matrix(found.camera_to_robot) * Rotation.from_rotvec(turn).inv()
    return error.as_rotvec(degrees=True)


@pytest.mark.long
@pytest.mark.parametrize("signs", [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
def test_camera_directions_and_zeros_are_found_together(signs) -> None:
    zeros = {"zero_1_rad": np.radians(9.0), "zero_2_rad": np.radians(-9.0)}
    found = fit_survey(seen(ASKEW, signs=signs, **zeros, friction_1=0.2), DESCRIPTION)
    assert found.reversed_motors == tuple(1 + axis for axis in (0, 1) if signs[axis] < 0)
    assert np.all(np.abs(off_deg(found, ASKEW)) < 2.0 * found.uncertainty_deg)
    zeros_off_rad = found.neutral_rad - np.array(signs) * np.radians((9.0, -9.0))
    assert np.all(np.abs(zeros_off_rad) < 2.0 * found.neutral_deviation_rad)
    assert not found.servos_are_as_described


@pytest.mark.long
def test_another_view_of_the_same_rests_changes_only_the_rotation() -> None:
    parameters = {"zero_1_rad": 0.05, "backlash_rad": 0.02, "taper_1": 0.1}
    here, there = (fit_survey(seen(turn, **parameters), DESCRIPTION) for turn in ((0, 0, 0), ASKEW))
    np.testing.assert_allclose(there.neutral_rad, here.neutral_rad, atol=1e-4)
    np.testing.assert_allclose(there.uncertainty_deg, here.uncertainty_deg, rtol=1e-2)
    np.testing.assert_allclose(off_deg(there, ASKEW), off_deg(here, (0, 0, 0)), atol=1e-2)
    np.testing.assert_allclose(there.rests.vectors_mm, here.rests.vectors_mm, atol=0.05)


@pytest.mark.long
@pytest.mark.parametrize(
    ("rests", "cause"),
    [
        (seen(ASKEW, swapped=True), "motors 1 and 2 are exchanged"),
        (seen(ASKEW, gain_1=1.4), "bend 1.4 and 1.4 times as far"),
        (seen(ASKEW, slack_2_rad=0.6), "a tendon of motor 2 is loose"),
        (
            seen(ASKEW, robot=Robot(gravity_direction=(0.0, 0.0, 1.0))),
            r"gravity along \[0, 0, 1\]",
        ),
        (
            seen(ASKEW, robot=Robot(gravity_direction=(1.0, 0.0, 0.0))),
            r"gravity along \[1, 0, 0\]",
        ),
    ],
)
def test_what_a_survey_cannot_correct_is_named(rests: Rests, cause: str) -> None:
    with pytest.raises(MisfitError, match=cause):
        fit_survey(rests, DESCRIPTION)


@pytest.mark.long
def test_markers_on_the_backbone_do_not_tell_up_from_down() -> None:
    flat = {"marker_offset_mm": 0.0, "body_per_mm": 0.0, "tip_per_mm": 0.0}
    description = schema.load(None, ["control.solver=compiled", "robot.marker_offset_mm=0"])
    with pytest.raises(SurveyError, match="do not tell up from down"):
        fit_survey(seen(ASKEW, robot=Robot(marker_offset_mm=0.0), **flat), description)


def changed(change) -> Rests:
    """Rests of the prior's robot with other markers, (N, 3, 3)."""
    rests = seen(ASKEW)
    return replace(rests, markers_mm=change(rests.markers_mm.copy()))


def moved_base(markers_mm):
    markers_mm[5:] += (0.0, 2.0, 0.0)
    return markers_mm


def without_motor_2(markers_mm):
    only_1 = stops_rad() * (1.0, 0.0)
    rests = Rests.in_turn(np.zeros(2), only_1, markers_mm, np.ones(len(only_1)))
    vectors_mm = predicted_mm(Scaling(ROBOT).parameters(np.zeros(COUNT)), rests)
    return Rests.of_vectors(rests.from_rad, only_1, vectors_mm, rests.count).markers_mm


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (moved_base, "M1 moved by"),
        (
            lambda markers_mm: np.broadcast_to(markers_mm[:1], markers_mm.shape),
            r"motor 1 moved M3 by 0\.0 mm only",
        ),
        (without_motor_2, "motor 2 moved M3"),
    ],
)
def test_a_robot_that_does_not_move_as_commanded_is_refused(change, cause: str) -> None:
    with pytest.raises(SurveyError, match=cause):
        fit_survey(changed(change), DESCRIPTION)


def ended_after(tour: Rests) -> int | None:
    """Number of poses after which a tour ends as it would tell nothing; None if it goes on."""
    alone_rad = safe_poses_rad(DESCRIPTION)
    for done in range(1, len(tour.q_rad) + 1):
        try:
            require_motion_so_far(tour.chosen(list(range(done))), DESCRIPTION, done, alone_rad)
        except SurveyError:
            return done
    return None


@pytest.mark.parametrize("motor", [1, 2])
def test_a_motor_that_moves_nothing_ends_the_tour_after_its_own_poses(motor: int) -> None:
    alone_rad = safe_poses_rad(DESCRIPTION)
    still = changed(without_motor_2 if motor == 2 else lambda m: np.broadcast_to(m[:1], m.shape))
    assert ended_after(still) == 1 + np.flatnonzero(alone_rad[:, motor - 1])[-1]


@pytest.mark.parametrize("zeros_rad", [(0.17, 0.17), (-0.17, 0.17)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_tour_in_which_every_motor_moves_the_tip_goes_on(zeros_rad, sign: float) -> None:
    zeros = {f"zero_{motor}_rad": zero for motor, zero in enumerate(zeros_rad, 1)}
    assert ended_after(seen(ASKEW, signs=(sign, -sign), **zeros)) is None


def test_a_motor_that_may_have_stayed_within_its_slack_does_not_end_the_tour() -> None:
    still = changed(without_motor_2).chosen(list(range(len(safe_poses_rad(DESCRIPTION)))))
    assert ended_after(replace(still, q_rad=still.q_rad * (1.0, 0.4))) is None


def test_too_few_rests_are_refused() -> None:
    with pytest.raises(SurveyError, match="11 poses"):
        fit_survey(seen().last(11), DESCRIPTION)


FOUND = Survey(
    rests=seen(),
    hysteresis_mm=np.zeros(2),
    camera_to_robot=np.eye(3),
    uncertainty_deg=np.full(3, 0.3),
    lengths_mm=np.array([58.5, 43.5]),
    direction=np.array([1.0, -1.0]),
    neutral_rad=np.radians([0.0, 1.0]),
    neutral_deviation_rad=np.radians([0.3, 0.1]),
    take_up_rad=np.radians([5.0, 5.0]),
    gain=np.array([2.8, 2.8]),
    fit=None,
)


def test_what_a_calibration_leaves_alone_stays() -> None:
    described = Servo(angle_min_deg=(-60.0, -70.0), pulse_per_90_deg_us=(950.0, 1050.0))
    kept = corrected(described, FOUND)
    assert kept.angle_min_deg == described.angle_min_deg
    assert kept.neutral_pulse_us == (1500.0, 1511.5)
    assert kept.pulse_per_90_deg_us == (950.0, -1050.0)


PULSE, SCALE = st.floats(1300.0, 1700.0), st.floats(500.0, 1500.0)


@given(*[st.tuples(PULSE, PULSE)] * 2, *[st.tuples(SCALE, SCALE)] * 2)
def test_another_calibration_means_other_angles_by_the_same_pulses(
    neutral, other_neutral, scale, other_scale
) -> None:
    before = Servo(neutral_pulse_us=neutral, pulse_per_90_deg_us=scale)
    after = Servo(neutral_pulse_us=other_neutral, pulse_per_90_deg_us=(-other_scale[0], scale[1]))
    again = recalibrated(FOUND.rests, before, after)

    def pulses_us(rests: Rests, servo: Servo) -> np.ndarray:
        return servo.neutral_pulse_us + np.degrees(rests.q_rad) / 90 * servo.pulse_per_90_deg_us

    np.testing.assert_allclose(pulses_us(again, after), pulses_us(FOUND.rests, before))
