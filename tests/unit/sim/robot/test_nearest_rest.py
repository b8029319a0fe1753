"""The nearest rest pose of twins of any number of motors."""

import numpy as np
import pytest

from ccr_host.description.schema import load
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium, NearestRest, nearest_rests

LIMIT_RAD = np.radians([60.0, 60.0])


def eight_mm() -> np.ndarray:
    phase = np.linspace(0.0, 2 * np.pi, 40)
    return np.stack([25 * np.sin(2 * phase), np.full(40, -85.0), 20 * np.sin(phase)], axis=1)


def found_from_the_last(twin, limit_rad, targets_mm):
    guesses_rad = np.zeros((len(targets_mm), len(limit_rad)))
    return nearest_rests(twin, -limit_rad, limit_rad, targets_mm, guesses_rad)


@pytest.mark.long
def test_no_rest_pose_of_two_motors_is_nearer():
    """The path takes both motors through their slack, where no derivative leads."""
    twin, targets_mm = Twin(), eight_mm()
    _, distances_mm = found_from_the_last(twin, LIMIT_RAD, targets_mm)
    equilibrium = Equilibrium(twin)
    angles_rad = np.linspace(-1.0, 1.0, 25) * LIMIT_RAD[0]
    grid_mm = np.array([equilibrium.tip_mm((a, b)) for a in angles_rad for b in angles_rad])
    on_grid_mm = np.linalg.norm(grid_mm - targets_mm[:, None], axis=2).min(axis=1)
    assert (distances_mm <= on_grid_mm + 0.01).all()


def test_the_motor_angles_hold_the_tip_at_the_distances():
    twin, targets_mm = Twin(), eight_mm()[::5]
    motors_rad, distances_mm = found_from_the_last(twin, LIMIT_RAD, targets_mm)
    equilibrium = Equilibrium(twin)
    tips_mm = np.array([equilibrium.tip_mm(motor_rad) for motor_rad in motors_rad])
    found_mm = np.linalg.norm(tips_mm - targets_mm, axis=1)
    assert found_mm == pytest.approx(distances_mm, abs=1e-3)


@pytest.mark.long
def test_a_path_of_rest_poses_has_no_distance_whatever_the_number_of_motors():
    for name in ("single", "two-spatial", "three-spatial"):
        twin = load(name).twin
        motors = len(twin.servo_neutral_us)
        limit_rad = np.radians(np.full(motors, 85.0))
        waves = np.linspace(0.0, 1.6, 5)[:, None] + np.arange(motors)
        equilibrium = Equilibrium(twin)
        targets_mm = np.array([equilibrium.tip_mm(0.5 * np.sin(wave)) for wave in waves])
        _, distances_mm = found_from_the_last(twin, limit_rad, targets_mm)
        assert distances_mm == pytest.approx(np.zeros(5), abs=0.02)


def test_limits_keep_the_motors_from_the_target():
    twin = load("two-spatial").twin
    free, limited = (
        NearestRest(twin, -limit, limit) for limit in (np.full(4, 1.4), np.full(4, 0.3))
    )
    target_mm = Equilibrium(twin).tip_mm([0.8, 0.0, 0.8, 0.0])
    assert limited.distance_mm(target_mm) > 5.0
    assert (abs(limited.motor_rad) <= 0.3 + 1e-9).all()
    assert free.distance_mm(target_mm) < 0.02


def test_a_guess_leads_out_of_a_minimum_that_is_not_the_nearest():
    limit_rad = np.radians([85.0, 85.0])
    target_mm = Equilibrium(Twin()).tip_mm((0.2, 1.3))
    stuck, told = (NearestRest(Twin(), -limit_rad, limit_rad) for _ in range(2))
    stuck.motor_rad = told.motor_rad = -limit_rad
    assert stuck.distance_mm(target_mm) > 5.0
    assert told.distance_mm(target_mm, guess_rad=limit_rad) < 0.05
