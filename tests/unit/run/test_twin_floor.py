import json

import numpy as np
import pytest

from ccr_host.description import schema
from ccr_host.run.execute import execute_quietly, reference_of
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult, ratio_to_twin_floor, summarise
from ccr_host.run.twin_floor import (
    floor_by_descent_mm,
    floor_on_map_mm,
    keep_static_map,
    static_map_of,
    twin_floor_mm,
)
from ccr_host.sim.robot.static_map import StaticMap


@pytest.fixture
def short_path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n3,10,35\n")
    return str(file)


@pytest.fixture
def narrow():
    """Limits that make a small map."""
    return ("servo.angle_min_deg=-20", "servo.angle_max_deg=20")


def _shaft_limits_deg(*overrides):
    static_map = static_map_of(schema.load("ideal", overrides), None)
    axes = static_map.axis_1_rad, static_map.axis_2_rad
    return [(round(np.degrees(a[0]), 6), round(np.degrees(a[-1]), 6)) for a in axes]


def test_the_map_covers_what_the_limits_of_angle_and_pulse_leave_of_the_true_shafts():
    few = ("servo.angle_min_deg=-4", "servo.angle_max_deg=[4, 2]")
    assert _shaft_limits_deg(*few) == [(-4, 4), (-4, 2)]
    other_neutral = (*few, "twin.servo_neutral_us=[1510, 1500]")
    assert _shaft_limits_deg(*other_neutral) == [(-4.9, 3.1), (-4, 2)]
    reversed_second = (*few, "twin.servo_us_per_90_deg=[1000, -1000]")
    assert _shaft_limits_deg(*reversed_second) == [(-4, 4), (-2, 4)]
    assert _shaft_limits_deg(*few, "servo.pulse_max_us=1510") == [(-4, 0.9), (-4, 0.9)]


@pytest.mark.parametrize("slow", ["servo.slew_deg_s=5", "twin.servo_rate_deg_s=5"])
def test_the_slower_of_board_and_servo_bounds_the_floor(slow):
    axis = np.radians(np.arange(-20.0, 21.0))
    x, y = np.meshgrid(np.degrees(axis), np.degrees(axis), indexing="ij")
    plane = StaticMap(axis, axis, np.stack([x, y, np.zeros_like(x)], axis=-1))
    reference = reference_of(RunOptions("8shape"))
    moved = np.zeros_like(reference.target_mm)
    moved[1::2, 0] = 12.0
    jumping = type(reference)(**{**vars(reference), "target_mm": moved})
    usual = floor_on_map_mm(plane, schema.load(), jumping)
    assert usual == pytest.approx(0.0, abs=1e-9)
    assert floor_on_map_mm(plane, schema.load(None, [slow]), jumping) > 2.0


def test_a_later_payload_and_a_push_leave_the_floor_as_it_is(short_path, narrow):
    def floor_mm(*overrides):
        options = RunOptions(short_path, "mpc", overrides=(*narrow, *overrides))
        description = options.description()
        return floor_on_map_mm(static_map_of(description, None), description, reference_of(options))

    undisturbed = floor_mm()
    push = "twin.push={force_n = [0, 0, 0.05], start_s = 0, end_s = 1}"
    assert floor_mm("twin.payload_g=5", "twin.payload_start_s=1") == undisturbed
    assert floor_mm(push) == undisturbed
    assert floor_mm("twin.payload_g=5") != undisturbed


def test_summary_and_floor_are_the_same_whether_or_not_the_map_was_kept(
    short_path, narrow, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    options = RunOptions(short_path, "open-loop", overrides=narrow)
    keep_static_map(options)
    (kept,) = (tmp_path / "cache" / "ccr-host").iterdir()
    result = execute_quietly(options)
    warm = summarise(result, twin_floor_mm=twin_floor_mm(result))
    kept.unlink()
    cold = summarise(result, twin_floor_mm=twin_floor_mm(result))
    assert json.dumps(warm) == json.dumps(cold)
    assert ratio_to_twin_floor(warm) == pytest.approx(
        warm["true_mean_error_mm"] / warm["twin_floor_mean_error_mm"]
    )
    assert warm["twin_floor_mean_error_mm"] > 0


def test_a_run_without_a_twin_has_no_floor(short_path):
    options = RunOptions(short_path, "mpc")
    nothing = RunResult(options, reference_of(options), [], None, None, 0.0)
    assert twin_floor_mm(nothing) is None
    assert ratio_to_twin_floor(summarise(nothing)) is None


def test_a_twin_without_rest_has_no_floor(short_path, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    result = execute_quietly(RunOptions(short_path, "open-loop", overrides=()))
    collapses = ("twin.payload_g=3000", "twin.bending_stiffness_nm_rad=0.0001")
    hopeless = RunResult(
        RunOptions(short_path, "mpc", overrides=collapses),
        result.reference, result.records, None, None, 0.0,
    )  # fmt: skip
    assert twin_floor_mm(hopeless) is None


def test_a_robot_of_four_motors_has_a_floor_that_is_kept(tmp_path):
    description = schema.load("two-spatial")
    reference = reference_of(RunOptions("helix", robot="two-spatial"))
    few = type(reference)(**{**vars(reference), "target_mm": reference.target_mm[:8]})
    computed = floor_by_descent_mm(description, few, tmp_path)
    (file,) = tmp_path.iterdir()
    assert file.name.startswith("floor-")
    assert 0 <= computed < 0.1
    assert floor_by_descent_mm(description, few, tmp_path) == computed
