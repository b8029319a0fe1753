import numpy as np
import pytest

from ccr_host.robot.setpoint_history import SetpointHistory

STILL = np.zeros(2)


def test_history_follows_ramps_and_knows_when_the_robot_stood():
    history = SetpointHistory(STILL)
    history.command(1.0, np.array([0.1, 0.0]), 0.5)
    assert history.at(1.25) == pytest.approx([0.05, 0.0])
    assert history.rate_at(1.25) == pytest.approx([0.2, 0.0])
    history.command(2.0, np.array([0.1, 0.0]), 0.5)
    assert history.rate_at(2.1) == pytest.approx([0.0, 0.0])
    assert history.resting_since(2.4) == pytest.approx(1.5)
    assert history.resting_since(1.2) == pytest.approx(1.2)


def test_a_command_during_a_ramp_starts_at_the_current_setpoint():
    history = SetpointHistory(STILL)
    history.command(0.0, np.array([1.0, 0.0]), 1.0)
    history.command(0.5, np.array([0.0, 0.0]), 1.0)
    assert history.at(1.0) == pytest.approx([0.25, 0.0])
    assert history.corners(0.2, 1.0) == [
        pytest.approx([0.5, 0.0]),
        pytest.approx([0.25, 0.0]),
    ]


def test_only_jumps_of_the_servos_jolt_the_structure_and_it_calms_down():
    history = SetpointHistory(STILL)
    history.command(0.0, np.array([0.02, 0.0]), 0.05)
    assert history.jolt_at(0.1) == 0.0
    history.command(0.2, np.array([0.3, 0.0]), 0.05)
    assert history.jolt_at(0.1) == 0.0
    assert history.jolt_at(0.2) > 0.15
    assert history.jolt_at(2.0) < 0.01


def test_a_ramp_interpolates_setpoint_and_index_and_then_holds():
    history = SetpointHistory(np.zeros(2))
    history.command(1.0, np.array([1.0, -1.0]), 0.5, 4.0)
    history.command(2.0, np.array([2.0, -2.0]), 0.5, 5.0)
    setpoint_rad, index = history.at(2.25), history.index_at(2.25)
    assert setpoint_rad == pytest.approx([1.5, -1.5])
    assert index == pytest.approx(4.5)
    setpoint_rad, index = history.at(9.0), history.index_at(9.0)
    assert setpoint_rad == pytest.approx([2.0, -2.0])
    assert index == 5.0


def test_before_the_first_command_the_initial_pose_aims_at_nothing():
    history = SetpointHistory(np.array([0.3, 0.4]))
    history.command(1.0, np.zeros(2), 0.5, 0.0)
    setpoint_rad, index = history.at(0.9), history.index_at(0.9)
    assert setpoint_rad == pytest.approx([0.3, 0.4])
    assert index is None


def test_a_command_starts_in_the_middle_of_the_ramp_it_replaces():
    history = SetpointHistory(np.zeros(2))
    history.command(1.0, np.ones(2), 1.0, 1.0)
    history.command(1.5, np.zeros(2), 1.0, 2.0)
    assert history.at(1.5) == pytest.approx([0.5, 0.5])
    assert history.at(2.0) == pytest.approx([0.25, 0.25])


def test_while_it_leaves_a_pose_that_aimed_at_nothing_there_is_no_index():
    history = SetpointHistory(np.zeros(2))
    history.command(1.0, np.ones(2), 1.0, 3.0)
    assert history.index_at(1.5) is None
    assert history.index_at(2.0) == 3.0


def test_two_seconds_are_remembered_however_fast_the_commands_come():
    history = SetpointHistory(np.zeros(2))
    for count in range(5000):
        history.command(0.001 * count, np.full(2, 0.001 * count), 0.0008, float(count))
    setpoint_rad, index = history.at(3.0), history.index_at(3.0)
    assert setpoint_rad == pytest.approx([3.0, 3.0], abs=0.002)
    assert index == pytest.approx(3000.0, abs=1.5)
