import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.sim.robot.robot import ServoModel

RATE_RAD_S = math.radians(300)


def usual_servo(deadband_rad: float) -> ServoModel:
    return ServoModel(1500.0, math.radians(0.09), RATE_RAD_S, deadband_rad)


def settled(deadband_rad: float, *pulses_us: float) -> float:
    servo = usual_servo(deadband_rad)
    for pulse_us in pulses_us:
        servo.set_pulse_us(pulse_us)
        servo.advance(10.0)
    return servo.angle_rad


@pytest.mark.parametrize(
    ("pulse_us", "angle_deg"), [(1500, 0), (2500, 90), (500, -90), (1000, -45)]
)
def test_pulse_width_is_an_angle(pulse_us, angle_deg):
    assert settled(0.0, pulse_us) == pytest.approx(math.radians(angle_deg))


def test_a_servo_may_be_off_and_turn_the_other_way():
    servo = ServoModel(1530.0, -math.radians(90) / 950, RATE_RAD_S, 0.0)
    servo.set_pulse_us(1530.0 + 95.0)
    servo.advance(10.0)
    assert math.degrees(servo.angle_rad) == pytest.approx(-9.0)


@given(st.lists(st.floats(500, 2500), min_size=1, max_size=20), st.floats(0, 0.2))
def test_shaft_never_turns_faster_than_its_rate_and_stops_within_the_deadband(pulses, deadband):
    servo = usual_servo(deadband)
    for pulse_us in pulses:
        servo.set_pulse_us(pulse_us)
        for _ in range(700):
            before = servo.angle_rad
            servo.advance(1e-3)
            assert abs(servo.angle_rad - before) <= RATE_RAD_S * 1e-3 * (1 + 1e-9)
        assert not servo.moving
        goal_rad = (pulse_us - 1500) * math.pi / 2000
        assert abs(servo.angle_rad - goal_rad) <= deadband + 1e-12


def test_deadband_swallows_small_changes_and_holds_short_on_either_side():
    band = math.radians(1.0)
    quarter_of_band_us = 1500 + 0.25 * 1000 / 90
    assert settled(band, quarter_of_band_us) == 0.0
    above, below = settled(band, 1700.0), settled(band, 2500.0, 1700.0)
    assert below - above == pytest.approx(2 * band)


def test_zero_pulse_leaves_the_shaft_where_it_is():
    servo = usual_servo(0.0)
    servo.set_pulse_us(2500.0)
    servo.advance(0.1)
    angle_rad = servo.angle_rad
    servo.set_pulse_us(0.0)
    servo.advance(1.0)
    assert servo.angle_rad == angle_rad == pytest.approx(math.radians(30))
    assert not servo.moving
