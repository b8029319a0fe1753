"""Every number of a description is bounded, and values out of bounds are reported clearly."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.link.board_config import board_config
from tests.unit.description.keys import KEYS, overrides, values

SCHEMA = schema.Description.model_json_schema()


def numbers(node: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every schema of a number, wherever it is."""
    if isinstance(node, dict):
        if node.get("type") in ("number", "integer"):
            yield path, node
        for key, part in node.items():
            yield from numbers(part, f"{path}/{key}")
    elif isinstance(node, list):
        for index, part in enumerate(node):
            yield from numbers(part, f"{path}/{index}")


def test_every_number_has_a_least_and_a_greatest_value() -> None:
    unbounded = [p for p, n in numbers(SCHEMA) if not {"minimum", "maximum"} <= n.keys()]
    assert unbounded == []


def refusal(*sets: str) -> str:
    with pytest.raises(ConfigError) as refused:
        schema.load(None, sets)
    message = f"{refused.value.cause}; {refused.value.cure}"
    for foreign in ("Input should", "valid dictionary", "tuple", "Value error", "pydantic", "\n"):
        assert foreign not in message
    return message


NONSENSE = ["1e308", "-1e308", "nan", "inf", "-inf", "true", '"12"', "[]", "{}"]


@pytest.mark.parametrize("key", sorted(KEYS))
def test_nonsense_for_any_key_is_refused_by_its_name(key: str) -> None:
    for value in NONSENSE:
        assert refusal(f"{key}={value}").startswith(key)


@pytest.mark.parametrize("digits", [20, 400, 5000])
@pytest.mark.parametrize("key", ["link.baud", "robot.pulley_radius_mm", "tracker.rotation_deg"])
def test_a_number_of_any_length_is_refused_on_one_short_line(key: str, digits: int) -> None:
    assert len(refusal(f"{key}={'9' * digits}")) < 300


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("robot.pulley_radius_mm=0.0125", "= 0.0125: too small; give a number from 1 to 200"),
        ("link.baud=2147483648", "too large; give a whole number from 9600 to 2000000"),
        ("link.baud=1.5", "not a whole number"),
        ("robot=3", "robot = 3: not a table"),
        ("robot.segment_lengths_mm=[60]", "[60.0]: give two values, or describe another robot"),
        ("robot.segment_lengths_mm=[60,10,60]", "[60.0, 10.0, 60.0]: give two values, or"),
        (
            "robot.segment_lengths_mm=60",
            "give a list in brackets, each member a number from 5 to 1000",
        ),
        ("control.solver=dqp", 'control.solver = "dqp": unknown; give daqp or compiled'),
        ("robot.board_name=über", r"board_name: '\xfcber' is not up to 16 printable"),
        ("robot.board_name=" + "x" * 17, "printable ASCII characters"),
        ("name=3", "name = 3: not text; give text in quotes"),
        ("polaris_faults.shuffle=1", "neither true nor false; give true or false"),
        ("polaris_faults.silent_s=[[1,2],[4,3]]", "silent_s (value 2): the interval [4, 3]"),
        ("polaris_faults.silent_s=[[1,2],[4]]", "silent_s (value 2 of value 2): missing"),
        ("tracker.tool_files={M1=3}", "tracker.tool_files.M1 = 3: not text"),
        (
            "twin.segments=[{length_mm=60, tendon_radius_mm=4, tendons=[{angle_deg=0, motor=1}]}]",
            "twin.segments has 1 segments, this robot has 2",
        ),
        ("twin.segments=[]", "twin.segments = []: too few values"),
        ("twin.slak_mm=1", "unknown key twin.slak_mm; did you mean slack_mm? known: "),
        ("slack_mm=1", "unknown key slack_mm; did you mean twin.slack_mm?"),
        ("robot.slack_mm=1", "unknown key robot.slack_mm; did you mean twin.slack_mm?"),
        ("robto.x=1", "unknown key robto; did you mean robot?"),
        ("servo.rest_deg=90", "rest_deg = 90 does not lie between the limits -85 and 85 deg"),
        ("servo.angle_min_deg=84.5", "angle_min_deg = 84.5 does not lie 1 deg or more below"),
        ("servo.pulse_min_us=1600", "neutral_pulse_us = 1500 does not lie between"),
        ("servo.pulse_max_us=500", "pulse_min_us = 500 does not lie 1 us or more below"),
        ("servo.pulse_max_us=500.25", "pulse_min_us = 500 does not lie 1 us or more below"),
        ("servo.pulse_per_90_deg_us=0", "pulse_per_90_deg_us = 0 of axis 1 is nearer to 0"),
        ("twin.servo_us_per_90_deg=0", "nearer to 0 than 50"),
        ("robot.tendon_radius_mm=1", "would bend a segment by 1062 deg, 540 are allowed"),
        ("registration={}", "registration.camera_to_robot_deg: missing; give three values"),
        ("robot.x=" + "[" * 5000, "unknown key robot.x"),
    ],
)
def test_errors_are_reported_in_terms_of_the_description(override: str, told: str) -> None:
    assert told in refusal(override)


def test_an_empty_name_of_a_description_is_not_the_default_one() -> None:
    with pytest.raises(ConfigError, match="robot description"):
        schema.load("")


def test_a_rest_pose_beyond_the_pulses_is_refused() -> None:
    message = refusal("servo.rest_deg=60", "servo.pulse_max_us=2000")
    assert "rest_deg = 60 would take a pulse of 2167 us" in message


SENT = [key for key in KEYS if key.startswith(("servo.", "link."))]


@given(st.fixed_dictionaries({key: values(KEYS[key]) for key in SENT}))
def test_the_board_takes_whatever_the_bounds_let_through(chosen: dict[str, list[float]]) -> None:
    try:
        description = schema.load(None, overrides(chosen))
    except ConfigError:
        return
    board_config(description)
