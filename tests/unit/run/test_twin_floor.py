import json

import numpy as np
import pytest

from ccr_host.run.execute import execute_quietly, reference_of
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult, ratio_to_twin_floor, summarise
from ccr_host.run.twin_floor import floor_of_run_mm, rests_along, twin_floor_mm
from ccr_host.sim.robot.equilibrium import Equilibrium

FAR_MM = ((500.0, -100.0, 500.0), (-500.0, -100.0, -500.0))
"""Targets that draw both motors to their limits."""


@pytest.fixture
def short_path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n3,10,35\n")
    return str(file)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "ccr-host"


def floor_mm(path, *overrides, cache=None, robot="ideal"):
    options = RunOptions(path, robot=robot, overrides=overrides)
    return twin_floor_mm(options, reference_of(options), cache)


def shaft_ranges_deg(*overrides):
    """Least and greatest shaft angle on the way to targets that no pose reaches."""
    options = RunOptions("8shape", robot="ideal", overrides=overrides)
    reference = reference_of(options)
    target_mm = np.resize(FAR_MM, reference.target_mm.shape)
    far = type(reference)(**{**vars(reference), "target_mm": target_mm})
    motors_deg = np.degrees(rests_along(options.description(), far, every=11)[0])
    return [*zip(motors_deg.min(axis=0).round(3), motors_deg.max(axis=0).round(3), strict=True)]


def test_shafts_move_as_far_as_the_limits_of_angle_and_pulse_allow():
    few = ("servo.angle_min_deg=-25", "servo.angle_max_deg=[25, 20]")
    assert shaft_ranges_deg(*few) == [(-25, 25), (-25, 20)]
    other_neutral = (*few, "twin.servo_neutral_us=[1510, 1500]")
    assert shaft_ranges_deg(*other_neutral) == [(-25.9, 24.1), (-25, 20)]
    reversed_second = (*few, "twin.servo_us_per_90_deg=[1000, -1000]")
    assert shaft_ranges_deg(*reversed_second) == [(-25, 25), (-20, 25)]
    narrow = (*few, "servo.pulse_max_us=1610")
    assert shaft_ranges_deg(*narrow) == [(-25, 9.9), (-25, 9.9)]


@pytest.mark.long
def test_where_the_path_is_out_of_reach_the_other_side_of_the_robot_is_tried():
    """Halfway along the helix the nearest pose changes from one limit of motor 2 to the other."""
    options = RunOptions("helix", robot="default")
    description, reference = options.description(), reference_of(options)
    _, distances_mm = rests_along(description, reference)
    equilibrium, angles_rad = Equilibrium(description.twin), np.radians(np.linspace(-85, 85, 13))
    grid_mm = np.array([equilibrium.tip_mm((a, b)) for a in angles_rad for b in angles_rad])
    on_grid_mm = np.linalg.norm(grid_mm - reference.target_mm[:, None], axis=2).min(axis=1)
    assert (distances_mm < on_grid_mm + 0.1).all()
    assert distances_mm.mean() < on_grid_mm.mean()


def test_a_later_payload_and_a_push_leave_the_floor_as_it_is(short_path):
    undisturbed = floor_mm(short_path)
    push = "twin.push={force_n = [0, 0, 0.05], start_s = 0, end_s = 1}"
    assert floor_mm(short_path, "twin.payload_g=5", "twin.payload_start_s=1") == undisturbed
    assert floor_mm(short_path, push) == undisturbed
    assert floor_mm(short_path, "twin.payload_g=5") != undisturbed


def test_summary_and_floor_are_the_same_whether_or_not_the_floor_was_kept(short_path, cache):
    result = execute_quietly(RunOptions(short_path, "open-loop"))
    cold = summarise(result, twin_floor_mm=floor_of_run_mm(result))
    (file,) = cache.iterdir()
    file.touch()
    written = file.stat().st_mtime_ns
    warm = summarise(result, twin_floor_mm=floor_of_run_mm(result))
    assert json.dumps(warm) == json.dumps(cold)
    assert file.stat().st_mtime_ns == written
    assert ratio_to_twin_floor(warm) == pytest.approx(
        warm["true_mean_error_mm"] / warm["twin_floor_mean_error_mm"]
    )
    assert warm["twin_floor_mean_error_mm"] > 0


@pytest.mark.long
def test_a_kept_floor_is_only_that_of_the_same_twin_path_and_limits(short_path, tmp_path):
    kept = tmp_path / "kept"
    for overrides in ((), ("twin.slack_mm=0.5",), ("servo.angle_max_deg=30",)):
        assert floor_mm(short_path, *overrides, cache=kept) == floor_mm(short_path, *overrides)
    assert floor_mm("8shape", cache=kept) == floor_mm("8shape")
    assert len([*kept.iterdir()]) == 4


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut off", b"not an archive"])
def test_a_damaged_file_is_computed_again(short_path, tmp_path, content):
    kept = tmp_path / "kept"
    computed = floor_mm(short_path, cache=kept)
    (file,) = kept.iterdir()
    whole = file.stat().st_size
    file.write_bytes(content)
    assert floor_mm(short_path, cache=kept) == computed
    assert file.stat().st_size == whole


def test_a_cache_that_cannot_be_written_does_not_matter(short_path, tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    assert floor_mm(short_path, cache=in_the_way) == floor_mm(short_path)


def test_a_run_without_a_twin_has_no_floor(short_path):
    options = RunOptions(short_path, "mpc")
    nothing = RunResult(options, reference_of(options), [], None, None, 0.0)
    assert floor_of_run_mm(nothing) is None
    assert ratio_to_twin_floor(summarise(nothing)) is None


def test_a_twin_without_rest_has_no_floor(short_path):
    collapses = ("twin.payload_g=3000", "twin.bending_stiffness_nm_rad=0.0001")
    assert floor_mm(short_path, *collapses) is None


def test_robots_of_other_kinds_have_a_floor():
    options = RunOptions("helix", robot="two-spatial")
    reference = reference_of(options)
    first = {"target_mm": reference.target_mm[:8], "q_rad": reference.q_rad[:8]}
    few = type(reference)(**{**vars(reference), **first})
    assert 0 <= twin_floor_mm(options, few) < 0.1
