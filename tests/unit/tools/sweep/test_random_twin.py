import math

import numpy as np
import pytest

from ccr_host.description import schema
from ccr_host.description.simulation import Tracker, Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin, friction_n

DURATION_S = 80.0
TWINS = 400


@pytest.fixture(scope="module")
def drawn():
    base = schema.load()
    return [draw_twin(np.random.default_rng(seed), base, DURATION_S) for seed in range(TWINS)]


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _column(drawn, key):
    return np.array([twin[key] for twin in drawn])


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [
        ("twin.slack_mm", 0.0, 2.0),
        ("twin.bending_stiffness_nm_rad", 0.01, 0.03),
        ("twin.disk_mass_g", 0.4, 1.2),
        ("twin.marker_mass_g", 1.5, 4.5),
        ("twin.payload_g", 0.0, 5.0),
        ("twin.servo_deadband_deg", 0.0, 1.0),
        ("twin.friction", 0.0, 0.437),
        ("twin.joint_damping", 0.6e-3, 2.4e-3),
        ("twin.capstan_friction", 0.0, 0.25),
        ("twin.stiffness_taper", -0.15, 0.15),
        ("twin.bending_plane_turn_deg", -2.0, 2.0),
        ("twin.servo_stall_torque_nm", 0.6, 1.1),
        ("twin.servo_droop_deg_per_nm", 0.0, 13.0),
        ("twin.servo_backlash_deg", 0.0, 1.0),
        ("twin.servo_lag_ms", 0.0, 40.0),
        ("twin.servo_drift_deg", -1.0, 1.0),
        ("tracker.outliers", 0.0, 0.01),
        ("tracker.frame_jitter_ms", 0.0, 3.0),
        ("tracker.exposure_ms", 0.0, 10.0),
        ("tracker.latency_ms", 0.0, 100.0),
        ("tracker.noise_mm", 0.0, 0.5),
        ("twin.servo_neutral_us", 1444.0, 1556.0),
        ("robot.tendon_radius_mm", 4.05, 4.95),
        ("robot.pulley_radius_mm", 11.25, 13.75),
        ("robot.marker_offset_mm", 13.5, 16.5),
    ],
)
def test_each_range_is_filled_and_never_left(drawn, key, low, high):
    values = _column(drawn, key)
    assert low <= values.min() <= low + 0.03 * (high - low)
    assert high >= values.max() >= high - 0.03 * (high - low)
    assert values.mean() == pytest.approx((low + high) / 2, abs=0.06 * (high - low))


def test_without_faults_the_rest_of_a_twin_is_the_same(drawn):
    plain = draw_twin(np.random.default_rng(0), schema.load(), DURATION_S, faults=False)
    kept = {key: value for key, value in drawn[0].items() if key in plain}
    changed = {key for key in plain if kept[key] != plain[key]}
    assert changed == {"twin.marker_offset_mm"}
    assert "twin.creep_share" not in plain


def test_every_effect_of_robot_and_camera_is_drawn(drawn):
    """A key that is added is drawn too, or said here to be none that differs between robots."""
    sections = {"twin": Twin, "tracker": Tracker}
    keys = {f"{name}.{key}" for name, model in sections.items() for key in model.model_fields}
    assert keys - drawn[0].keys() == {
        "twin.segments",
        "twin.flexures",
        "twin.payload_start_s",
        "twin.tendon_stiffness_n_m",
        "twin.tendon_force_max_n",
        "twin.servo_rate_deg_s",
        "twin.servo_us_per_90_deg",
        "twin.gravity_m_s2",
        "twin.time_step_ms",
        "tracker.rate_hz",
        "tracker.tool_files",
        "tracker.camera_file",
        "tracker.tag_size_mm",
    }


def test_the_camera_is_turned_by_at_most_five_degrees_about_any_axis(drawn):
    vectors = _column(drawn, "tracker.rotation_deg")
    angles = np.linalg.norm(vectors, axis=1)
    assert 4.8 < angles.max() <= 5.001
    assert np.abs((vectors / angles[:, None]).mean(axis=0)).max() < 0.1


def test_slack_differs_between_the_tendons_of_a_motor_by_at_most_half_a_millimetre(drawn):
    slack_mm = _column(drawn, "twin.slack_mm")
    unequal_mm = np.abs(slack_mm[:, :2] - slack_mm[:, 2:])
    assert 0.45 < unequal_mm.max() <= 0.5001


def test_the_push_lasts_five_seconds_within_the_path(drawn):
    pushes = _column(drawn, "twin.push")
    forces = np.linalg.norm([push["force_n"] for push in pushes], axis=1)
    starts, ends = (np.array([push[k] for push in pushes]) for k in ("start_s", "end_s"))
    assert 0.048 < forces.max() <= 0.05001
    assert ends - starts == pytest.approx(5.0, abs=0.011), "to four digits"
    assert starts.min() >= 0
    assert ends.max() <= DURATION_S + 0.011
    assert starts.max() > 0.9 * (DURATION_S - 5)


def test_a_short_path_is_pushed_all_along():
    twin = draw_twin(np.random.default_rng(1), schema.load(), 3.0)
    assert (twin["twin.push"]["start_s"], twin["twin.push"]["end_s"]) == (0.0, 3.0)


def test_factors_apply_to_the_description_that_is_given(drawn):
    softer = schema.load("soft")
    twin = draw_twin(np.random.default_rng(0), softer, DURATION_S)
    share = np.array(twin["twin.bending_stiffness_nm_rad"]) / softer.twin.bending_stiffness_nm_rad
    usual = np.array(drawn[0]["twin.bending_stiffness_nm_rad"]) / 0.02
    assert share == pytest.approx(usual, rel=1e-3)


def test_overrides_say_exactly_what_was_drawn(drawn):
    for twin in drawn[:20]:
        description = schema.load(None, as_overrides(twin))
        for key, value in twin.items():
            section, name = key.split(".")
            there = getattr(getattr(description, section), name)
            assert _plain(there.model_dump() if name == "push" else there) == value


@pytest.mark.parametrize("motor", [0, 1])
def test_friction_of_a_dead_zone_lets_a_motor_turn_back_by_twice_the_zone(motor):
    base, zone_deg = schema.load(), 1.0
    friction = friction_n(base, zone_deg)
    twin = base.twin.model_copy(update={"friction": friction, "joint_damping": 2e-3})
    mechanics = Mechanics(twin, 0.0)

    def tip_mm(angle_deg, seconds):
        angles = [0.0, 0.0]
        angles[motor] = math.radians(angle_deg)
        mechanics.pull(angles)
        mechanics.advance(round(seconds * 1e6 / mechanics.step_us))
        markers = mechanics.markers_mm()
        return markers[2] - markers[0]

    for angle_deg in np.arange(0.0, 30.1, 1.0):
        tip_mm(angle_deg, 0.1)
    turned = tip_mm(30.0, 1.0)
    assert np.linalg.norm(tip_mm(30.0 - 1.6 * zone_deg, 0.5) - turned) < 0.2
    assert np.linalg.norm(tip_mm(30.0 - 2.6 * zone_deg, 0.5) - turned) > 0.4


@pytest.mark.parametrize("name", ["single", "two-spatial", "three-spatial"])
def test_tendons_of_any_robot_rub_no_more_than_measured_ones(name):
    base = schema.load(name)
    rubbing_n = [
        draw_twin(np.random.default_rng(seed), base, DURATION_S)["twin.friction"]
        for seed in range(20)
    ]
    assert 0.3 < max(rubbing_n) <= 0.5


@pytest.mark.parametrize("name", ["single", "two-spatial", "three-spatial"])
def test_a_twin_of_any_robot_has_every_effect_and_another_belief_of_its_geometry(name, drawn):
    base = schema.load(name)
    twin = draw_twin(np.random.default_rng(1), base, DURATION_S)
    assert set(twin) == {*drawn[0], "robot.segments"} - {
        "robot.segment_lengths_mm",
        "robot.tendon_radius_mm",
    }
    description = schema.load(name, as_overrides(twin))
    assert description.twin.segment_lengths_mm == base.twin.segment_lengths_mm
    assert description.twin.tendon_radius_mm == base.twin.tendon_radius_mm
    off = np.divide(description.robot.segment_lengths_mm, base.robot.segment_lengths_mm) - 1.0
    assert (np.abs(off) > 0.0).all()
    assert (np.abs(off) <= 0.1001).all()
    assert [s.tendons for s in description.robot.segments] == [
        s.tendons for s in base.robot.segments
    ]
    assert len(description.twin.servo_drift_deg) == base.robot.motors
    Mechanics(description.twin, 0.0)
