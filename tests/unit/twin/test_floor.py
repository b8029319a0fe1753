import numpy as np
import pytest

from ccr_host.config import Twin
from ccr_host.twin.floor import floor_of
from ccr_host.twin.mechanics import Mechanics
from ccr_host.twin.static_map import Equilibrium, StaticMap, compute_static_map, load_static_map


def _plane():
    """A map that is the plane z = 0, one mm a degree."""
    axis = np.radians(np.arange(-20.0, 21.0))
    x, y = np.meshgrid(np.degrees(axis), np.degrees(axis), indexing="ij")
    return StaticMap(axis, axis, np.stack([x, y, np.zeros_like(x)], axis=-1))


FAST = np.radians([1000.0, 1000.0])


def test_the_floor_is_the_distance_to_the_surface_between_the_grid_points():
    targets = np.array([[0.3, 0.4, 2.0], [5.5, -7.25, -3.0], [23.0, 0.5, 4.0]])
    floor = floor_of(_plane(), targets, 1.0, FAST)
    assert floor.per_step_mm == pytest.approx((2.0 + 3.0 + 5.0) / 3)
    assert floor.within_rate_mm == pytest.approx(floor.per_step_mm)


def test_a_slow_servo_raises_the_floor_by_what_it_cannot_follow():
    targets = np.array([[0.0, 0.5, 0.0], [12.0, 0.5, 0.0]])
    slow = floor_of(_plane(), targets, 1.0, np.radians([4.0, 4.0]))
    assert slow.per_step_mm == pytest.approx(0.0, abs=1e-9)
    a_cell_at_each_end_mm = 3.0
    assert 8.0 - a_cell_at_each_end_mm <= 2 * slow.within_rate_mm <= 8.0


def test_rest_poses_are_those_the_simulation_comes_to():
    twin = Twin(friction=0.0, joint_damping=2e-3)
    mechanics = Mechanics(twin, 0.0)
    mechanics.pull(0.3, -0.5)
    mechanics.advance(round(6e6 / mechanics.step_us))
    markers = mechanics.markers_mm()
    rest_mm = Equilibrium(twin).tip_mm(0.3, -0.5)
    assert rest_mm == pytest.approx(markers[2] - markers[0], abs=1e-3)


def test_a_kept_map_is_read_back_and_another_twin_gets_its_own(tmp_path):
    lower, upper = np.array([-10.0, -10.0]), np.array([10.0, 10.0])
    first = load_static_map(Twin(), lower, upper, tmp_path, 10.0)
    again = load_static_map(Twin(), lower, upper, tmp_path, 10.0)
    other = load_static_map(Twin(slack_mm=0.5), lower, upper, tmp_path, 10.0)
    assert np.array_equal(first.tip_mm, again.tip_mm)
    assert len(list(tmp_path.iterdir())) == 2
    assert not np.allclose(first.tip_mm, other.tip_mm)


def test_the_map_does_not_depend_on_the_way_it_was_walked():
    twin, lower, upper = Twin(), np.array([-40.0, -60.0]), np.array([40.0, 60.0])
    found = compute_static_map(twin, lower, upper, 20.0)
    for i, j in ((0, 0), (1, 4), (4, 6)):
        direct = Equilibrium(twin).tip_mm(found.axis_1_rad[i], found.axis_2_rad[j])
        assert found.tip_mm[i, j] == pytest.approx(direct, abs=1e-4)
