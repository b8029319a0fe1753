"""The nearest reachable configuration: least distance, limits, continuity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.any_robot import built, path_text, random_robot
from ccr_host.description.schema import Robot, Servo
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.workspace import MotorLimits, Workspace

PAPER = ConstantCurvature(Robot())
LIMITS = MotorLimits.of(Servo())
WORKSPACE = Workspace(PAPER, LIMITS)

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
near = st.floats(-90, 90)
geometries = st.builds(
    Robot,
    segment_lengths_mm=st.tuples(st.floats(20, 120), st.floats(20, 120)),
    tendon_radius_mm=st.floats(2, 10),
    marker_offset_mm=st.floats(0, 40),
    pulley_radius_mm=st.floats(5, 20),
)


def lateral(model: ConstantCurvature, q_rad: np.ndarray) -> np.ndarray:
    return model.tip_mm(q_rad)[..., [0, 2]]


def least_distance_on_grid(model, limits, points, per_axis=181):
    axes = np.linspace(limits.lower_rad, limits.upper_rad, per_axis)
    grid = np.stack(np.meshgrid(axes[:, 0], axes[:, 1]), axis=-1).reshape(-1, 2)
    reached = lateral(model, grid)
    return np.array([np.hypot(*(reached - point).T).min() for point in points])


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(
    geometry=geometries,
    limit_deg=st.tuples(st.floats(5, 120), st.floats(5, 120)),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_configuration_within_the_limits_is_nearer(geometry, limit_deg, seed):
    model = ConstantCurvature(geometry)
    limits = MotorLimits(-np.radians(limit_deg), np.radians(limit_deg))
    reach = sum(geometry.segment_lengths_mm)
    points = np.random.default_rng(seed).uniform(-reach, reach, (8, 2))
    found = Workspace(model, limits).nearest(points)
    by_search = least_distance_on_grid(model, limits, points)
    assert np.all(found.distance_mm <= by_search + 1e-6 * reach)
    claimed = np.hypot(*(lateral(model, found.q_rad) - points).T)
    assert found.distance_mm == pytest.approx(claimed, abs=1e-9 * reach)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(first=finite, second=finite)
def test_any_finite_point_gets_a_configuration_within_the_limits(first, second):
    found = WORKSPACE.nearest([[first, second]])
    assert np.all(np.isfinite(found.q_rad))
    assert np.all((found.q_rad >= LIMITS.lower_rad) & (found.q_rad <= LIMITS.upper_rad))
    assert found.distance_mm[0] >= 0.0


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(
    geometry=geometries,
    lower_deg=st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000)),
    width_deg=st.tuples(st.floats(1e-3, 6000), st.floats(1e-3, 6000)),
    point=st.tuples(near, near),
)
def test_any_limits_are_kept_even_those_that_exclude_the_straight_robot(
    geometry, lower_deg, width_deg, point
):
    lower = np.radians(lower_deg)
    limits = MotorLimits(lower, lower + np.radians(width_deg))
    found = Workspace(ConstantCurvature(geometry), limits).nearest([point])
    assert np.all((found.q_rad >= limits.lower_rad) & (found.q_rad <= limits.upper_rad))
    assert np.isfinite(found.distance_mm[0])


@settings(max_examples=60, deadline=None)
@given(first=st.floats(-0.5, 0.5), second=st.floats(-0.8, 0.8))
def test_inside_the_workspace_it_inverts_the_model(first, second):
    q = np.array([[first, second]])
    found = WORKSPACE.nearest(lateral(PAPER, q))
    assert found.q_rad == pytest.approx(q, abs=1e-9)
    assert found.distance_mm[0] < 1e-10


@pytest.mark.long
@settings(max_examples=20, deadline=None)
@given(
    radii=st.tuples(st.floats(5, 60), st.floats(5, 80)),
    middle=st.tuples(st.floats(-20, 20), st.floats(-30, 30)),
    turns=st.tuples(st.integers(1, 3), st.integers(1, 3)),
)
def test_finer_sampling_of_a_smooth_path_stays_on_the_same_branch(radii, middle, turns):
    """Also across the edge of the workspace, where the branches meet."""

    def path(samples):
        phase = 2 * np.pi * np.arange(samples + 1) / samples
        return np.stack(
            [
                middle[0] + radii[0] * np.cos(turns[0] * phase),
                middle[1] + radii[1] * np.sin(turns[1] * phase),
            ],
            axis=-1,
        )

    coarse = WORKSPACE.nearest(path(80)).q_rad
    fine = WORKSPACE.nearest(path(1600)).q_rad
    assert fine[::20] == pytest.approx(coarse, abs=1e-7)
    assert fine[-1] == pytest.approx(fine[0], abs=1e-7)
    # At one fold the angle goes with the square root of the distance, at a corner of two folds
    # with the fourth; the other branch would be half a radian away.
    spacing_mm = np.hypot(*np.diff(path(1600), axis=0).T)
    steps_rad = np.abs(np.diff(fine, axis=0)).max(axis=1)
    assert np.all(steps_rad <= 0.3 * spacing_mm**0.25)


def test_sideways_reach_ends_at_31_52_mm():
    found = WORKSPACE.nearest([[35.0, 0.0], [-1e6, 0.0]])
    assert np.abs(lateral(PAPER, found.q_rad)[:, 0]) == pytest.approx([31.5206] * 2, abs=1e-4)
    assert np.degrees(np.abs(found.q_rad[:, 1])) == pytest.approx([48.08] * 2, abs=0.01)
    assert found.distance_mm[0] == pytest.approx(35.0 - 31.5206, abs=1e-4)


def test_boundary_is_a_closed_line_that_touches_the_limits_of_reach():
    rim = WORKSPACE.boundary_mm(40)
    assert rim.shape == (41, 3)
    assert rim[0] == pytest.approx(rim[-1])
    assert np.abs(rim[:, 0]).max() == pytest.approx(31.5206, abs=1e-4)
    outward = rim[:, [0, 2]] * 1.01
    assert np.all(WORKSPACE.nearest(outward).distance_mm > 0.0)


def random_workspaces(count: int, segments: tuple[int, ...]):
    """Workspaces of random robots, and motor angles well within their limits, (20, n)."""
    rng = np.random.default_rng(count)
    for number in range(count):
        model = ConstantCurvature(random_robot(rng, segments[number % len(segments)]))
        most_rad = 1.2 / np.abs(model.bending_rad(np.eye(model.motors))).sum(axis=1)
        limits = MotorLimits(-most_rad, most_rad)
        yield Workspace(model, limits), 0.4 * most_rad * rng.uniform(-1, 1, (20, model.motors))


@pytest.mark.parametrize("coordinates", [[0, 2], [0, 1, 2]])
def test_with_more_motors_than_needed_no_motion_that_keeps_the_tip_saves_effort(coordinates):
    for workspace, q in random_workspaces(12, (1, 2, 3, 4)):
        model, most_rad = workspace.model, workspace.limits.upper_rad
        found = workspace.nearest(model.tip_mm(q)[:, coordinates])
        assert found.distance_mm.max() < 1e-7 * sum(model.lengths_mm)
        assert np.all(np.abs(found.q_rad) <= most_rad)
        for pose in found.q_rad:
            free = np.abs(pose) < most_rad
            _, sizes, directions = np.linalg.svd(model.jacobian_mm_rad(pose)[coordinates][:, free])
            keeping = directions[np.sum(sizes > 1e-6 * sizes[0]) :]
            slope = (workspace.effort @ pose)[free] * most_rad.min()
            assert np.abs(keeping @ slope).max(initial=0.0) < 1e-6


def test_neighbouring_points_have_neighbouring_configurations_however_many_motors():
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    for workspace, _ in random_workspaces(4, (2, 3)):
        length = sum(workspace.model.lengths_mm)
        circle = 0.15 * length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        share = workspace.nearest(circle).q_rad / workspace.limits.upper_rad
        assert share[0] == pytest.approx(share[-1], abs=1e-6)
        assert np.abs(np.diff(share, axis=0)).max() < 0.2


@pytest.mark.parametrize("rate_hz", [1.0, 20.0])
@pytest.mark.parametrize("number", [25, 35, 49, 57])
def test_a_path_that_a_smooth_motion_makes_has_no_jumps_in_its_configurations(number, rate_hz):
    rng = np.random.default_rng(number)
    robot = built(rng, 1 + number % 4)
    model = ConstantCurvature(robot)
    rows = np.array([row.split(",") for row in path_text(robot, rng).split()[1:]], dtype=float)
    time_s = np.arange(round(60.0 * rate_hz) + 1) / rate_hz
    points = np.stack([np.interp(time_s, rows[:, 0], rows[:, 1 + i]) for i in (1, 0, 2)], axis=1)
    most_rad = np.full(model.motors, np.radians(Servo().angle_max_deg[0]))
    workspace = Workspace(model, MotorLimits(-most_rad, most_rad))
    alone, followed = workspace.nearest(points), workspace.along(points)
    before, after = (
        np.abs(np.diff(model.bending_rad(found.q_rad), axis=0)).max() for found in (alone, followed)
    )
    # The path itself bends segments by 0.2 rad a second and more.
    assert after < min(0.5 * before, 0.4)
    assert np.all(followed.distance_mm < 1e-3)
    assert np.all(np.abs(followed.q_rad) <= workspace.limits.upper_rad)


def test_without_a_choice_a_path_that_meets_no_jump_has_the_configurations_of_its_points():
    for workspace, q in random_workspaces(8, (1, 2)):
        points = workspace.model.tip_mm(np.linspace(0.2 * q[0], 0.2 * q[1], 30))
        if len(workspace.model.segment_of_freedom) <= 3:
            assert np.array_equal(workspace.along(points).q_rad, workspace.nearest(points).q_rad)


def with_a_choice(count: int):
    """Workspaces of robots with more degrees of freedom than coordinates, and a closed path."""
    phase = np.linspace(0.0, 2.0 * np.pi, 61)[:, None]
    for workspace, q in random_workspaces(count, (2, 3, 4)):
        if len(workspace.model.segment_of_freedom) > 3:
            swings = q[0] * np.cos(phase) + q[1] * np.sin(2.0 * phase)
            yield workspace, workspace.model.tip_mm(0.7 * swings)


@pytest.mark.long
def test_with_a_choice_configurations_change_less_along_a_path_and_keep_the_tip_on_it():
    for workspace, points in with_a_choice(6):
        alone, along = workspace.nearest(points), workspace.along(points)
        assert along.distance_mm.max() < 1e-5 * workspace.length_mm
        assert np.array_equal(workspace.limits.clip(along.q_rad), along.q_rad)
        before, after = (np.diff(found.q_rad, axis=0) for found in (alone, along))
        changes = [((step @ workspace.effort) * step).sum() for step in (before, after)]
        assert changes[1] <= changes[0] * (1.0 + 1e-6)


@pytest.mark.long
def test_with_a_choice_a_closed_path_is_closed_in_motor_angles_even_if_its_start_is_not_repeated():
    for workspace, points in with_a_choice(6):
        whole, open_ended = workspace.along(points).q_rad, workspace.along(points[:-1]).q_rad
        assert whole[-1] == pytest.approx(whole[0], abs=1e-9)
        assert open_ended == pytest.approx(whole[:-1], abs=1e-6)


@pytest.mark.long
def test_with_a_choice_even_changes_are_found_at_the_limits_of_motors_too():
    for workspace, points in with_a_choice(3):
        most_rad = 0.9 * np.abs(workspace.nearest(points).q_rad).max(axis=0)
        narrow = Workspace(workspace.model, MotorLimits(-most_rad, most_rad))
        found, along = narrow.nearest(points), narrow.along(points)
        assert np.array_equal(narrow.limits.clip(along.q_rad), along.q_rad)
        assert np.all(along.distance_mm < found.distance_mm + 1e-5 * workspace.length_mm)


def test_with_a_choice_a_path_that_stands_still_has_the_configuration_of_its_point():
    workspace, points = next(with_a_choice(3))
    still = np.repeat(points[:1], 5, axis=0)
    assert np.array_equal(workspace.along(still).q_rad, workspace.nearest(still).q_rad)
