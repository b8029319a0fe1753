import numpy as np
import pytest

from ccr_host.control.baselines.command_log import CommandLog


def test_a_ramp_interpolates_setpoint_and_index_and_then_holds():
    log = CommandLog(np.zeros(2))
    log.command(1.0, np.array([1.0, -1.0]), 4.0, 0.5)
    log.command(2.0, np.array([2.0, -2.0]), 5.0, 0.5)
    setpoint_rad, index = log.at(2.25)
    assert setpoint_rad == pytest.approx([1.5, -1.5])
    assert index == pytest.approx(4.5)
    setpoint_rad, index = log.at(9.0)
    assert setpoint_rad == pytest.approx([2.0, -2.0])
    assert index == 5.0


def test_before_the_first_command_the_initial_pose_aims_at_nothing():
    log = CommandLog(np.array([0.3, 0.4]))
    log.command(1.0, np.zeros(2), 0.0, 0.5)
    setpoint_rad, index = log.at(0.9)
    assert setpoint_rad == pytest.approx([0.3, 0.4])
    assert index is None


def test_a_command_goes_on_from_the_middle_of_the_ramp_it_replaces():
    log = CommandLog(np.zeros(2))
    log.command(1.0, np.ones(2), 1.0, 1.0)
    log.command(1.5, np.zeros(2), 2.0, 1.0)
    assert log.at(1.5)[0] == pytest.approx([0.5, 0.5])
    assert log.at(2.0)[0] == pytest.approx([0.25, 0.25])


def test_while_it_leaves_a_pose_that_aimed_at_nothing_there_is_no_index():
    log = CommandLog(np.zeros(2))
    log.command(1.0, np.ones(2), 3.0, 1.0)
    assert log.at(1.5)[1] is None
    assert log.at(2.0)[1] == 3.0


def test_two_seconds_are_remembered_however_fast_the_commands_come():
    log = CommandLog(np.zeros(2))
    for count in range(5000):
        log.command(0.001 * count, np.full(2, 0.001 * count), float(count), 0.0008)
    setpoint_rad, index = log.at(3.0)
    assert setpoint_rad == pytest.approx([3.0, 3.0], abs=0.002)
    assert index == pytest.approx(3000.0, abs=1.5)
