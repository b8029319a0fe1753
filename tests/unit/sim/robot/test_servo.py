import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.sim.robot.robot import ServoModel, ServoProperties

RATE_RAD_S = math.radians(300)


def usual_servo(deadband_rad: float = 0.0, **effects: float) -> ServoModel:
    return ServoModel(
        ServoProperties(1500.0, math.radians(0.09), RATE_RAD_S, deadband_rad, **effects)
    )


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
    servo = ServoModel(ServoProperties(1530.0, -math.radians(90) / 950, RATE_RAD_S))
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


def turned_under(servo: ServoModel, load_nm: float, duration_s: float) -> float:
    """Angle of the output shaft, rad, after a load has acted."""
    for step in range(round(duration_s * 1000)):
        servo.feel(load_nm, (step + 1) * 1e-3, 1e-3)
        servo.advance(1e-3)
    return servo.angle_rad


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("load", "speed"), [(0.0, 1.0), (-0.25, 0.75), (-1.2, 0.0), (0.3, 1.0)])
def test_speed_falls_linearly_with_an_opposing_load_to_zero_at_the_stall_torque(sign, load, speed):
    servo = usual_servo(stall_torque_nm=1.0)
    servo.set_pulse_us(1500.0 + sign * 1000)
    turned_rad = turned_under(servo, sign * load, 0.1)
    assert turned_rad == pytest.approx(sign * speed * 0.1 * RATE_RAD_S, abs=1e-9)


@given(st.floats(-1, 1), st.floats(0, 1))
def test_a_resting_shaft_sags_towards_its_load_in_proportion(load_nm, droop_rad_nm):
    servo = usual_servo(droop_rad_nm=droop_rad_nm)
    servo.set_pulse_us(1700.0)
    angle_rad = turned_under(servo, load_nm, 1.0)
    assert angle_rad == pytest.approx(math.radians(18) + droop_rad_nm * load_nm, abs=1e-6)


def test_stiff_tendons_find_their_balance_with_droop_and_backlash():
    """A stiff spring to 0 rad: the load falls as the shaft gives way, without chatter."""
    stiffness_nm_rad, droop_rad_nm = 300.0, 0.2
    servo = usual_servo(
        droop_rad_nm=droop_rad_nm, play_rad=0.01, load_stiffness_nm_rad=stiffness_nm_rad
    )
    servo.set_pulse_us(1520.0)
    angles_rad = []
    for step in range(4000):
        servo.feel(-stiffness_nm_rad * servo.angle_rad, step * 1e-3, 1e-3)
        servo.advance(1e-3)
        angles_rad.append(servo.angle_rad)
    without_load_rad = math.radians(1.8) - 0.005
    balance_rad = without_load_rad / (1 + stiffness_nm_rad * droop_rad_nm)
    assert angles_rad[-1] == pytest.approx(balance_rad, rel=1e-3)
    assert max(angles_rad[-100:]) - min(angles_rad[-100:]) < 1e-6


def test_without_load_the_output_lags_the_motor_by_half_the_backlash_on_either_side():
    play_rad = math.radians(1.0)

    def reached(*pulses_us: float) -> float:
        servo = usual_servo(play_rad=play_rad)
        for pulse_us in pulses_us:
            servo.set_pulse_us(pulse_us)
            servo.advance(10.0)
        return servo.angle_rad

    from_below, from_above = reached(1700.0), reached(1900.0, 1700.0)
    assert from_above - from_below == pytest.approx(play_rad)
    assert (from_above + from_below) / 2 == pytest.approx(math.radians(18))
    assert reached(1500.0 + 0.4 * 1000 / 90) == 0.0


@pytest.mark.parametrize("load_nm", [0.05, -0.05])
@pytest.mark.parametrize("first_us", [1900.0, 1500.0])
def test_a_load_decides_the_side_of_the_backlash_whatever_the_motion(load_nm, first_us):
    servo = usual_servo(play_rad=math.radians(1.0))
    servo.set_pulse_us(first_us)
    turned_under(servo, load_nm, 0.5)
    servo.set_pulse_us(1700.0)
    angle_deg = math.degrees(turned_under(servo, load_nm, 0.5))
    assert angle_deg == pytest.approx(18.0 + math.copysign(0.5, load_nm))


def test_backlash_moves_a_servo_without_pulses_too_but_nothing_else_does():
    servo = usual_servo(play_rad=math.radians(1.0), droop_rad_nm=0.2)
    assert math.degrees(turned_under(servo, 0.1, 0.5)) == pytest.approx(0.5)


def test_the_neutral_position_drifts_with_its_time_constant():
    servo = usual_servo(drift_rad=math.radians(2.0), drift_time_s=600.0)
    servo.set_pulse_us(1500.0)
    angles_deg = []
    for time_s in (0.0, 600.0, 60_000.0):
        servo.feel(0.0, time_s, 0.002)
        servo.advance(1.0)
        angles_deg.append(math.degrees(servo.angle_rad))
    assert angles_deg == pytest.approx([0.0, 2.0 * (1 - math.exp(-1)), 2.0])
