"""Robots of any number of segments: what a description of them may say, and who reads it."""

from __future__ import annotations

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import load, load_any, parse

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


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("length_mm = 60", "length_mm = 60\nstifness = 2", "did you mean stiffness"),
        ("motor = 1 }", "motor = 1, pulley = 2 }", "unknown key robot.segments.tendons.pulley"),
        ("winding = -1", "winding = 0", "winding = 0 is neither 1 nor -1"),
        ("motor = 1", "motor = 2", "no tendon is wound by motor 1 of 2"),
        ("length_mm = 60", "length_mm = 0.06", "too small"),
        ("length_mm = 60", "", "length_mm"),
    ],
)
def test_mistakes_are_told_in_one_line(right, wrong, told):
    with pytest.raises(ConfigError) as refused:
        parse(SEGMENT.replace(right, wrong))
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_whoever_knows_two_planar_segments_only_refuses_other_robots(tmp_path):
    file = tmp_path / "robot.toml"
    file.write_text(SEGMENT)
    assert load_any(str(file)).robot.segments
    with pytest.raises(ConfigError, match="only ccr-host identify reads"):
        load(str(file))
