"""The nearest rest pose of twins of any number of motors."""

import numpy as np
import pytest

from ccr_host.description.schema import load
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium
from ccr_host.sim.robot.floor import floor_of
from ccr_host.sim.robot.nearest_rest import NearestRest, distances_mm
from ccr_host.sim.robot.static_map import compute_static_map

LIMIT_DEG = np.array([60.0, 60.0])
FAST_DEG = np.array([1000.0, 1000.0])


def eight_mm() -> np.ndarray:
    phase = np.linspace(0.0, 2 * np.pi, 40)
    return np.stack([25 * np.sin(2 * phase), np.full(40, -85.0), 20 * np.sin(phase)], axis=1)


def test_of_two_motors_it_is_as_near_as_the_map_of_all_rest_poses():
    """The path takes both motors through their slack, where no derivative leads."""
    twin, targets_mm = Twin(), eight_mm()
    grid = compute_static_map(twin, -LIMIT_DEG, LIMIT_DEG, 2.0)
    followed_mm = distances_mm(twin, -LIMIT_DEG, LIMIT_DEG, targets_mm, FAST_DEG)
    for target_mm, distance_mm in zip(targets_mm, followed_mm, strict=True):
        on_map_mm = floor_of(grid, target_mm[None], 1.0, np.radians(FAST_DEG)).per_step_mm
        assert distance_mm == pytest.approx(on_map_mm, abs=0.1)


def test_a_path_of_rest_poses_has_no_distance_whatever_the_number_of_motors():
    for name in ("single", "two-spatial", "three-spatial"):
        twin = load(name).twin
        motors = len(twin.servo_neutral_us)
        limit_deg = np.full(motors, 85.0)
        waves = np.linspace(0.0, 3.0, 8)[:, None] + np.arange(motors)
        equilibrium = Equilibrium(twin)
        targets_mm = np.array([equilibrium.tip_mm(0.5 * np.sin(wave)) for wave in waves])
        followed_mm = distances_mm(twin, -limit_deg, limit_deg, targets_mm, 10 * limit_deg)
        assert followed_mm == pytest.approx(np.zeros(8), abs=0.02)


def test_limits_and_rates_keep_the_motors_from_the_target():
    twin = load("two-spatial").twin
    free, limited = (
        NearestRest(twin, -limit, limit) for limit in (np.full(4, 1.4), np.full(4, 0.3))
    )
    target_mm = Equilibrium(twin).tip_mm([0.8, 0.0, 0.8, 0.0])
    assert free.distance_mm(target_mm, reach_rad=0.1) > limited.distance_mm(target_mm) > 5.0
    assert (abs(free.motor_rad) <= 0.1 + 1e-9).all()
    assert (abs(limited.motor_rad) <= 0.3 + 1e-9).all()
    assert free.distance_mm(target_mm) < 0.02
