from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.errors import ConfigError
from ccr_host.core.wire import cdeg_to_rad, rad_to_cdeg
from ccr_host.description.schema import load
from ccr_host.link import messages as m
from ccr_host.link.board_config import board_config


def test_default_description_in_the_units_of_the_wire():
    config = board_config(load())
    assert config.limits == m.Limits((-8500, -8500), (8500, 8500), (0, 0))
    assert config.slew == m.Slew((600, 600))  # 300 deg/s in 20 ms
    assert config.watchdog == m.Watchdog(2000, 60, 300)
    assert config.calibration == m.Calibration((3000,) * 2, (2000,) * 2, (1000,) * 2, (5000,) * 2)


def test_rates_are_rounded_down():
    config = board_config(load(None, ["servo.slew_deg_s=299.9", "link.relax_slew_deg_s=5.4"]))
    assert config.slew.slew_cdeg_tick == (599, 599)
    assert config.watchdog.relax_slew_cdeg_tick == 10


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("servo.angle_max_deg=136", "servo.angle_max_deg"),
        ("servo.slew_deg_s=0.1", "servo.slew_deg_s"),
        ("servo.slew_deg_s=1001", "servo.slew_deg_s"),
        ("link.relax_slew_deg_s=300", "link.relax_slew_deg_s"),
        ("servo.pulse_max_us=2501", "servo.pulse_max_us"),
        ("servo.pulse_max_us=1e9", "servo.pulse_max_us"),
        ("servo.pulse_min_us=499", "servo.pulse_min_us"),
        ("servo.pulse_per_90_deg_us=2001", "servo.pulse_per_90_deg_us"),
        ("servo.pulse_per_90_deg_us=40", "servo.pulse_per_90_deg_us"),
        ("servo.angle_max_deg=[85, -84.999]", "servo.angle_min_deg"),
    ],
)
def test_what_the_board_cannot_take_names_its_key(override, key):
    overrides = [override]
    if "-84.999" in override:
        overrides.append("servo.rest_deg=[0, -84.9995]")
    with pytest.raises(ConfigError) as refusal:
        board_config(load(None, overrides))
    assert key in refusal.value.cause
    assert refusal.value.cure


@given(st.integers(-18000, 18000))
def test_angles_survive_the_way_to_rad_and_back(angle_cdeg):
    assert rad_to_cdeg(cdeg_to_rad([angle_cdeg])) == [angle_cdeg]


def test_right_angle_in_both_units():
    assert rad_to_cdeg(np.array([pi / 2, -pi / 4])) == [9000, -4500]
    assert cdeg_to_rad([9000, -4500]).tolist() == [pi / 2, -pi / 4]


@pytest.mark.parametrize("angle", [float("nan"), float("inf")])
def test_what_is_no_angle_is_never_sent(angle):
    with pytest.raises(ValueError, match="cannot be sent"):
        rad_to_cdeg(np.array([angle, 0.0]))


@pytest.mark.parametrize(
    ("deg_s2", "expected"), [(0, (0, 0)), ([25, 50_000], (1, 2000)), ([500, 49], (20, 1))]
)
def test_acceleration_is_rounded_down_to_what_the_wire_carries(deg_s2, expected):
    description = load(None, [f"servo.acceleration_deg_s2={deg_s2}"])
    assert board_config(description).acceleration == m.Acceleration(expected)


def test_acceleration_too_small_for_the_wire_is_refused_instead_of_being_none():
    description = load(None, ["servo.acceleration_deg_s2=24.9"])
    with pytest.raises(ConfigError, match=r"servo.acceleration_deg_s2: .*it takes 25 and more"):
        board_config(description)
