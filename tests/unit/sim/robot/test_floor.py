import numpy as np
import pytest

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium
from ccr_host.sim.robot.floor import floor_of
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.static_map import StaticMap, compute_static_map, load_static_map
from tests.unit.sim.robot.test_keys import CHANGED


def _plane():
    """A map of the plane z = 0, one mm per degree."""
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


def test_the_nearest_point_is_found_wherever_the_surface_folds():
    rng = np.random.default_rng(5)
    flat = _plane()
    folded = StaticMap(
        flat.axis_1_rad, flat.axis_2_rad, 20 * np.sin(flat.tip_mm / 6) + flat.tip_mm[..., ::-1] / 3
    )
    targets = rng.uniform(-15, 15, (40, 3))
    shares = np.linspace(0, 1, 11)
    corner, by_1, by_2, across = (
        folded.tip_mm[i : 40 + i, j : 40 + j, None] for i, j in ((0, 0), (1, 0), (0, 1), (1, 1))
    )
    weights = np.array([(a, b) for a in shares for b in shares if a + b <= 1 + 1e-9])
    points = [
        start + weights[:, :1] * (one - start) + weights[:, 1:] * (two - start)
        for start, one, two in ((corner, by_1, by_2), (across, by_2, by_1))
    ]
    cloud = np.concatenate([p.reshape(-1, 3) for p in points])
    longest_edge_mm = max(
        np.linalg.norm(np.diff(folded.tip_mm, axis=a), axis=2).max() for a in (0, 1)
    )
    sampled_mm = np.array([np.linalg.norm(cloud - target, axis=1).min() for target in targets])
    alone_mm = np.array([floor_of(folded, t[None], 1.0, FAST).per_step_mm for t in targets])
    too_far_mm = sampled_mm - alone_mm
    assert (too_far_mm >= -1e-9).all()
    assert (too_far_mm <= longest_edge_mm / 10).all()
    assert too_far_mm.mean() < longest_edge_mm / 100
    together = floor_of(folded, targets, 1.0, FAST)
    assert together.per_step_mm == pytest.approx(np.mean(alone_mm))


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {
            "gravity_m_s2": (5.0, 6.0, -6.0),
            "axial_stiffness_n_m": (8000.0, 5000.0),
            "torsion_stiffness_nm_rad": (0.05, 0.08),
            "sideways_stiffness_nm_rad": (0.2, 0.1),
            "stiffness_taper": (0.2, -0.1),
            "stiffening": (0.3, 0.5),
            "bending_plane_turn_deg": (2.0, -3.0),
            "marker_offset_mm": (1.0, 2.0, 14.0),
            "creep_share": 0.3,
            "creep_time_s": 0.2,
        },
    ],
)
def test_rest_poses_are_those_reached_by_the_simulation(keys):
    twin = Twin(friction=0.0, joint_damping=2e-3, **keys)
    mechanics = Mechanics(twin, 0.0)
    mechanics.pull((0.3, -0.5))
    mechanics.advance(round(6e6 / mechanics.step_us))
    markers = mechanics.markers_mm()
    rest_mm = Equilibrium(twin).tip_mm((0.3, -0.5))
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
        direct = Equilibrium(twin).tip_mm((found.axis_1_rad[i], found.axis_2_rad[j]))
        assert found.tip_mm[i, j] == pytest.approx(direct, abs=1e-4)


def test_a_finely_walked_map_rests_where_a_coarse_walk_does():
    lower, upper = np.array([-40.0, -60.0]), np.array([40.0, 60.0])
    for twin in (Twin(), Twin(slack_mm=0.2, payload_g=5.0, bending_stiffness_nm_rad=(0.012, 0.02))):
        coarse = compute_static_map(twin, lower, upper, 20.0)
        fine = compute_static_map(twin, lower, upper, 4.0)
        assert fine.tip_mm[::5, ::5] == pytest.approx(coarse.tip_mm, abs=1e-3)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"not an archive"])
def test_a_damaged_cache_is_computed_again(tmp_path, content):
    lower, upper = np.array([-10.0, -10.0]), np.array([10.0, 10.0])
    first = load_static_map(Twin(), lower, upper, tmp_path, 10.0)
    (file,) = tmp_path.iterdir()
    file.write_bytes(content)
    again = load_static_map(Twin(), lower, upper, tmp_path, 10.0)
    assert np.array_equal(first.tip_mm, again.tip_mm)
    assert file.stat().st_size > 500, "mended"


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    found = load_static_map(Twin(), np.array([0.0, 0.0]), np.array([5.0, 5.0]), in_the_way, 5.0)
    assert np.isfinite(found.tip_mm).all()


@pytest.mark.long
@pytest.mark.parametrize("key", sorted(Twin.model_fields.keys() - {"segments"}))
def test_twins_that_share_a_kept_map_rest_alike(tmp_path, key):
    lower, upper = np.array([0.0, 0.0]), np.array([30.0, 30.0])
    usual = Twin(payload_g=0.5)
    changed = usual.model_copy(update={key: CHANGED[key]})
    load_static_map(usual, lower, upper, tmp_path, 30.0)
    kept_mm = load_static_map(changed, lower, upper, tmp_path, 30.0).tip_mm
    assert kept_mm == pytest.approx(compute_static_map(changed, lower, upper, 30.0).tip_mm)
