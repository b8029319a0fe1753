"""A servo whose horn sits some degrees off is found, and costs the path next to nothing."""

from functools import cache

import numpy as np
import pytest

from ccr_host.control.adaptive.compiled import CompiledModel
from ccr_host.control.adaptive.identification import StaticsFit
from ccr_host.control.adaptive.misfit import zeros_off
from ccr_host.control.adaptive.model import tour_bending_rad
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Parameters, Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for, zeros_rad
from ccr_host.description import schema
from ccr_host.robot.rests import Rests
from ccr_host.run.execute import execute_quietly
from ccr_host.run.observer import true_errors_mm
from ccr_host.run.options import RunOptions

OFF = "twin.servo_neutral_us=[1533,1467]"
"""Zeros that are 3 deg off, one each way."""
FAST = "control.solver=compiled"
"""The same commands for three quarters of the CPU."""
UNEQUAL = "twin.slack_mm=[1.6,0.9,0.8,1.5]"
PATHS = ["8shape", *(pytest.param(path, marks=pytest.mark.slow) for path in ("ellipse", "star"))]
REGISTERED = (
    "registration.camera_to_robot_deg=[0,0,0]",
    "registration.uncertainty_deg=[0.28,0.07,0.14]",
)


@cache
def error_mm(path: str, *overrides: str) -> float:
    result = execute_quietly(RunOptions(path=path, overrides=(*overrides, FAST)))
    errors_mm = true_errors_mm(result.records)
    assert errors_mm is not None
    return float(np.linalg.norm(errors_mm, axis=1).mean())


@pytest.mark.long
@pytest.mark.parametrize("path", PATHS)
def test_under_a_registered_camera_zeros_cost_little(path: str) -> None:
    limit_mm = 1.15 * error_mm(path, *REGISTERED)
    assert error_mm(path, *REGISTERED, OFF) < limit_mm
    assert error_mm(path, *REGISTERED, UNEQUAL) < limit_mm


@pytest.mark.long
@pytest.mark.parametrize("path", PATHS)
def test_under_a_camera_that_was_never_registered_too(path: str) -> None:
    assert error_mm(path, OFF) < 1.15 * error_mm(path)


@pytest.mark.long
def test_bending_planes_that_are_off_are_not_taken_for_a_registered_camera_that_is_turned() -> None:
    registered = REGISTERED[:1]
    wrong = "twin.bending_plane_turn_deg=[1.5,1.5]", "twin.stiffness_taper=[0.13,0.13]"
    assert error_mm("8shape", *registered, *wrong) < 2.0 * error_mm("8shape", *registered)


def rests_of(truth: Parameters) -> Rests:
    """The tour of a robot of the model's form, without noise."""
    stops_rad = unhindered_setpoints_for(truth, tour_bending_rad())
    rests = Rests.in_turn(
        np.zeros(2), stops_rad, np.zeros((len(stops_rad), 3, 3)), np.full(20, 6.0)
    )
    rests.markers_mm[:, 1:] = predicted_mm(truth, rests)
    return rests


@pytest.mark.long
@pytest.mark.parametrize(
    "robot",
    [
        {"plane_1_rad": 0.03, "plane_2_rad": -0.02},
        {"taper_1": 0.2, "taper_2": -0.1, "stiffening": 0.06},
        {"sideways": 0.03, "twisting": 0.5},
        {"marker_aside_mm": -0.7},
    ],
)
def test_what_is_the_robots_is_not_blamed_on_the_camera(
    compiled: CompiledModel, robot: dict[str, float]
) -> None:
    scaling = Scaling.of(schema.load())
    truth = scaling.parameters(np.zeros(COUNT))._replace(**robot)
    found = scaling.parameters(StaticsFit(scaling, rests_of(truth), compiled).finish().score)
    turn_rad = np.array([found.turn_x_rad, found.turn_y_rad, found.turn_z_rad])
    assert np.degrees(np.abs(turn_rad)).max() < 0.5
    for name, value in robot.items():
        assert getattr(found, name) == pytest.approx(value, rel=0.5)


@pytest.mark.long
def test_the_end_of_segment_1_tells_a_zero_from_a_turned_camera(compiled: CompiledModel) -> None:
    scaling = Scaling.of(schema.load())
    truth = scaling.parameters(np.zeros(COUNT))._replace(zero_1_rad=0.06, turn_x_rad=-0.05)
    rests = rests_of(truth)
    seen_mm = predicted_mm(truth, rests)
    off_rad = []
    for first in (0, 1):  # with M2, and without
        rests.markers_mm[:, 1:] = seen_mm
        rests.markers_mm[:, 1 : 1 + first] = np.nan
        found = scaling.parameters(StaticsFit(scaling, rests, compiled).finish().score)
        off_rad.append([abs(found.turn_x_rad + 0.05), abs(zeros_rad(found)[0] - 0.06)])
    assert np.all(off_rad[0] < np.multiply(off_rad[1], 0.7))


def test_a_registered_rotation_is_believed_as_precisely_as_it_was_stated() -> None:
    turned = Scaling.of(schema.load(None, REGISTERED)).parameters(np.ones(COUNT))
    found_deg = np.degrees([turned.turn_x_rad, turned.turn_y_rad, turned.turn_z_rad])
    assert found_deg == pytest.approx((0.28, 0.1, 0.14))
    unknown = Scaling.of(schema.load(None, [])).parameters(np.ones(COUNT))
    assert np.degrees(unknown.turn_x_rad) > 3.0


@pytest.mark.parametrize(
    ("zeros_deg", "told"),
    [
        ((-7.9, -0.03), "of motor 1 is off by -8 deg"),
        ((0.4, 14.2), "of motor 2 is off by 14 deg"),
        ((-8.0, 8.0), "of motor 1 is off by -8 deg and of motor 2 is off by 8 deg"),
        ((0.9, 0.2), "of motor 1 is off by 1 deg"),
    ],
)
def test_only_a_zero_that_is_off_is_named(zeros_deg: tuple[float, float], told: str) -> None:
    assert zeros_off(np.radians(zeros_deg)) == told
