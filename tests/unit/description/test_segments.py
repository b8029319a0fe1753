"""Robots of any number of segments: what a description of them may say, and who reads it."""

from __future__ import annotations

import json

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description, Robot, load, parse

SEGMENT = """
[[robot.segments]]
length_mm = 60
tendon_radius_mm = 4.5
tendons = [{ angle_deg = 0, motor = 1 }, { angle_deg = 180, motor = 1, winding = -1 }]
"""


def test_segments_are_read_from_the_base_to_the_tip():
    second = SEGMENT.replace("60", "40").replace("motor = 1", "motor = 2")
    segments = parse(SEGMENT + second).robot.segments
    assert [s.length_mm for s in segments] == [60, 40]
    assert [t.motor for t in segments[1].tendons] == [2, 2]


def test_clocked_holes_decide_whether_a_tendon_lies_across_the_plane():
    planar = 'length_mm = 60\nbends = "plane"\ndirection_deg = 60\nclocking_deg ='
    crossing, bending = (SEGMENT.replace("length_mm = 60", f"{planar} {deg}") for deg in (-30, 30))
    assert parse(bending).robot.motors == 1
    with pytest.raises(ConfigError, match="motor 1 bends no segment"):
        parse(crossing)


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("length_mm = 60", "length_mm = 60\nstifness = 2", "did you mean stiffness"),
        ("motor = 1 }", "motor = 1, pulley = 2 }", "unknown key robot.segments.tendons.pulley"),
        ("winding = -1", "winding = 0", "winding = 0 is neither 1 nor -1"),
        ("motor = 1", "motor = 2", "no tendon is wound by motor 1 of 2"),
        ("length_mm = 60", "length_mm = 0.06", "too small"),
        ("length_mm = 60", "", "robot.segments.length_mm (segment 1): missing"),
        ("length_mm = 60", "lenght_mm = 60", "did you mean length_mm"),
        ("winding = -1", "winding = -1.5", "winding (tendon 2 of segment 1) = -1.5"),
        ("angle_deg = 180", "angle_deg = 0", "motor 1 bends no segment"),
        (
            "length_mm = 60",
            'length_mm = 60\nbends = "plane"\ndirection_deg = 90',
            "motor 1 bends no",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(right, wrong, told):
    with pytest.raises(ConfigError) as refused:
        parse(SEGMENT.replace(right, wrong))
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


FOUR_TENDONS = """
[[robot.segments]]
length_mm = 60
tendon_radius_mm = 4
tendons = [
  { angle_deg = 0, motor = 1 }, { angle_deg = 180, motor = 1, winding = -1 },
  { angle_deg = 90, motor = 2 }, { angle_deg = 270, motor = 2, winding = -1 },
]

[[robot.segments]]
length_mm = 40
tendon_radius_mm = 3
bends = "plane"
tendons = [{ angle_deg = 0, motor = 3 }]
"""


def test_the_paper_s_robot_is_a_chain_of_two_planar_segments():
    robot = Robot()
    assert [(s.bends, s.length_mm, s.direction_deg) for s in robot.chain] == [
        ("plane", 58.5, 90.0),
        ("plane", 43.5, 0.0),
    ]
    assert robot.motors == 2
    assert robot.markers == ("M1", "M2", "M3")
    tendons = [(segment, t.angle_deg, t.motor, t.winding) for segment, t in robot.tendons]
    assert tendons == [(0, 90.0, 1, 1), (1, 0.0, 2, 1), (0, 270.0, 1, -1), (1, 180.0, 2, -1)]


def test_tendons_are_numbered_by_their_place_in_each_segment():
    robot = parse(FOUR_TENDONS).robot
    assert [(segment, t.motor) for segment, t in robot.tendons] == [
        (0, 1), (1, 3), (0, 1), (0, 2), (0, 2)
    ]  # fmt: skip
    assert robot.motors == 3


def test_numbers_and_defaults_stand_for_all_parts_of_any_robot():
    set_by_number = "[servo]\nangle_max_deg = 60\n[twin]\nslack_mm = 0.5\nfriction = 0.1\n"
    description = parse(FOUR_TENDONS + set_by_number)
    assert description.servo.angle_max_deg == (60, 60, 60)
    assert description.servo.angle_min_deg == (-85, -85, -85)
    twin = description.twin
    assert twin.slack_mm == (0.5,) * 5
    assert twin.flexures == (6, 5)
    assert twin.servo_neutral_us == (1500, 1500, 1500)
    assert twin.segments == description.robot.segments
    assert twin.segment_lengths_mm == (60, 40)
    assert twin.tendon_radius_mm == (4, 3)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (
            "[servo]\nrest_deg = [0, 0]",
            "servo.rest_deg = [0, 0]: this robot has 3 motors, give",
        ),
        ("[twin]\nslack_mm = [1, 1]", "this robot has 5 tendons, give one number or 5 values"),
        ("[twin]\nflexures = [6]", "this robot has 2 segments, give 2 values in brackets"),
        ("[robot]\ntendon_radius_mm = 4", "robot.segments another one: remove one of them"),
    ],
)
def test_values_that_do_not_match_the_robot_are_refused(more, told):
    text = (
        FOUR_TENDONS.replace("[[robot", f"{more}\n[[robot", 1)
        if "[robot]" in more
        else (FOUR_TENDONS + more)
    )
    with pytest.raises(ConfigError) as refused:
        parse(text)
    assert told in str(refused.value)


@pytest.mark.parametrize("name", ["single", "two-spatial", "three-spatial", "default"])
def test_a_description_that_was_written_out_is_read_again(name: str) -> None:
    description = load(name)
    assert Description.model_validate(json.loads(description.model_dump_json())) == description
