"""The twin's time grid, determinism and passive servos."""

import numpy as np
import pytest

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.robot import TwinRobot


def test_it_starts_at_rest_under_gravity():
    robot = TwinRobot(Twin())
    start = robot.tip_mm()
    robot.advance_to(2_000_000)
    np.testing.assert_allclose(robot.tip_mm(), start, atol=1e-4)


def drive(robot: TwinRobot, pulses_half_us, chunk_us: int) -> np.ndarray:
    for k in range(4):
        robot.set_pulses_half_us(pulses_half_us(5 * k, 40 - 20 * k))
        for time_us in range(k * 250_000 + chunk_us, (k + 1) * 250_000 + 1, chunk_us):
            robot.advance_to(time_us)
    return np.concatenate([robot.markers_mm().ravel(), robot.servo_angles_rad()])


def test_same_commands_give_the_same_bits(pulses_half_us):
    first, second = (drive(TwinRobot(Twin(friction=0.2)), pulses_half_us, 50_000) for _ in "ab")
    assert first.tobytes() == second.tobytes()


def test_state_does_not_depend_on_how_often_it_is_read(pulses_half_us):
    seldom, often = (drive(TwinRobot(Twin()), pulses_half_us, us) for us in (250_000, 2_500))
    assert seldom.tobytes() == often.tobytes()


def test_grid_does_not_drift(pulses_half_us):
    """A step of 1/3 ms becomes 333 us: after 10 s the next grid point is 10.000323 s."""
    robot = TwinRobot(Twin(time_step_ms=1 / 3))
    robot.advance_to(10_000_000)
    robot.set_pulses_half_us(pulses_half_us(10, 0))
    robot.advance_to(10_000_322)
    assert robot.servo_angles_rad()[0] == 0
    robot.advance_to(10_000_323)
    assert robot.servo_angles_rad()[0] == pytest.approx(np.radians(300) * 333e-6)


def test_time_never_runs_backwards(pulses_half_us):
    robot = TwinRobot(Twin())
    robot.set_pulses_half_us(pulses_half_us(10, 10))
    robot.advance_to(20_000)
    there = robot.tip_mm()
    robot.advance_to(10_000)
    np.testing.assert_array_equal(robot.tip_mm(), there)


def test_servo_without_pulses_keeps_its_angle_and_continues_with_the_next_pulse(pulses_half_us):
    robot = TwinRobot(Twin())
    robot.set_pulses_half_us(pulses_half_us(30, -30))
    robot.advance_to(50_000)
    halfway = robot.servo_angles_rad()
    robot.set_pulses_half_us((0, pulses_half_us(0, -30)[1]))
    robot.advance_to(1_000_000)
    assert robot.servo_angles_rad()[0] == halfway[0]
    assert np.degrees(robot.servo_angles_rad()[1]) == pytest.approx(-30, abs=0.03)
    robot.set_pulses_half_us(pulses_half_us(30, -30))
    robot.advance_to(2_000_000)
    assert np.degrees(robot.servo_angles_rad()[0]) == pytest.approx(30, abs=0.03)


def test_tip_is_marker_3_seen_from_marker_1():
    robot = TwinRobot(Twin())
    markers = robot.markers_mm()
    np.testing.assert_array_equal(robot.tip_mm(), markers[2] - markers[0])
