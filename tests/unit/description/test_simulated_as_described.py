"""Without hardware the described robot is simulated, unless the twin's keys are set."""

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.description.section import followed_key
from ccr_host.description.simulation import Tracker, Twin
from ccr_host.run.execute import execute_quietly
from ccr_host.run.observer import true_errors_mm
from ccr_host.run.options import RunOptions
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin

OWN = {
    "robot.segment_lengths_mm": "[70.0, 50.0]",
    "robot.tendon_radius_mm": "5.0",
    "robot.marker_offset_mm": "12.0",
    "robot.pulley_radius_mm": "15.0",
    "robot.gravity_direction": "[0.0, 3.0, 4.0]",
    "servo.neutral_pulse_us": "[1540.0, 1460.0]",
    "servo.pulse_per_90_deg_us": "[-950.0, 1050.0]",
    "registration.camera_to_robot_deg": "[40.0, -100.0, 70.0]",
}
FOLLOWERS = {
    followed_key(field): (section, name)
    for section, model in (("twin", Twin), ("tracker", Tracker))
    for name, field in model.model_fields.items()
    if followed_key(field) and name != "segments"  # see test_segments.py
}


def value(description: Description, key: str) -> object:
    section, name = key.split(".")
    return getattr(getattr(description, section), name)


def test_every_key_that_is_followed_is_tried_here() -> None:
    assert FOLLOWERS.keys() == OWN.keys()


@pytest.mark.parametrize("key", OWN)
def test_the_simulation_follows_the_description(key: str) -> None:
    description = schema.load("ideal", [f"{key}={OWN[key]}"])
    given = value(description, key)
    expected = {
        "robot.tendon_radius_mm": (given, given),
        "robot.marker_offset_mm": (0.0, 0.0, given),
        "robot.gravity_direction": pytest.approx((0.0, 0.6 * 9.81, 0.8 * 9.81)),
    }.get(key, given)
    assert value(description, ".".join(FOLLOWERS[key])) == expected


def test_a_direction_of_gravity_needs_a_length() -> None:
    with pytest.raises(ConfigError, match=r"robot.gravity_direction.*has no direction"):
        schema.load(None, ["robot.gravity_direction=[0,0,0]"])


@pytest.mark.parametrize("key", OWN)
def test_what_is_set_wins_even_if_it_is_the_default(key: str) -> None:
    section, name = FOLLOWERS[key]
    usual = value(Description(), f"{section}.{name}")
    text = str(list(usual) if isinstance(usual, tuple) else usual)
    description = schema.load("ideal", [f"{key}={OWN[key]}", f"{section}.{name}={text}"])
    assert value(description, f"{section}.{name}") == usual


@pytest.mark.long
def test_a_robot_of_other_measures_is_followed_without_hardware() -> None:
    overrides = tuple(f"{key}={value}" for key, value in OWN.items())
    fast = (*overrides, "control.solver=compiled")
    result = execute_quietly(RunOptions(path="8shape", overrides=fast))
    errors_mm = true_errors_mm(result.records)
    assert errors_mm is not None
    assert np.linalg.norm(errors_mm, axis=1).mean() < 1.5


def test_a_sweep_draws_what_is_believed_and_leaves_the_robot_as_it_is() -> None:
    base = schema.load(None, ["robot.segment_lengths_mm=[70, 50]"])
    drawn = draw_twin(np.random.default_rng(1), base, 80.0)
    description = schema.load(None, as_overrides(drawn))
    assert description.twin.segment_lengths_mm == (70.0, 50.0)
    assert description.robot.segment_lengths_mm != (70.0, 50.0)
