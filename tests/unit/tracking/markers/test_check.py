"""Markers compared with the robot: exchanged ones are named, the robot's own never refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import TrackerError
from ccr_host.description import schema
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

FRAME_US = 50_000
NAMES = {
    (2, 1, 0): "M1 and M3",
    (1, 0, 2): "M1 and M2",
    (0, 2, 1): "M2 and M3",
    (1, 2, 0): "M1, M2 and M3",
    (2, 0, 1): "M1, M2 and M3",
}
ROBOT = schema.load()


def rest_mm(description: schema.Description = ROBOT) -> np.ndarray:
    robot = TwinRobot(description.twin)
    robot.advance_to(500_000)
    return robot.markers_mm()


@pytest.fixture(scope="module")
def at_rest() -> np.ndarray:
    return rest_mm()


@pytest.mark.parametrize("order", NAMES)
@pytest.mark.parametrize("in_robot_frame", [True, False])
def test_every_exchange_is_named(at_rest, order, in_robot_frame) -> None:
    check = MarkerCheck(ROBOT, in_robot_frame=in_robot_frame)
    cause, cure = check.trouble(at_rest[list(order)])
    assert f"{NAMES[order]} are exchanged" in cause
    assert "tool_files" in cure


def test_without_m2_the_direction_at_rest_tells(at_rest) -> None:
    markers_mm = at_rest[[2, 1, 0]]
    markers_mm[1] = np.nan
    assert "M1 and M3 are exchanged, or" in MarkerCheck(ROBOT).trouble(markers_mm)[0]
    assert MarkerCheck(ROBOT, in_robot_frame=False).trouble(markers_mm) is None
    assert MarkerCheck(ROBOT).trouble(markers_mm[[2, 1, 0]]) is None


def test_segments_of_one_length_leave_it_to_the_direction() -> None:
    equal = schema.load(None, ["robot.segment_lengths_mm=[50, 50]"])
    markers_mm = rest_mm(equal)
    assert MarkerCheck(equal).trouble(markers_mm) is None
    assert "M1 and M3" in MarkerCheck(equal).trouble(markers_mm[[2, 1, 0]])[0]
    assert "M2 and M3 are exchanged" in MarkerCheck(equal).trouble(markers_mm[[0, 2, 1]])[0]


@pytest.mark.parametrize("turn_deg", [(180, 0, 0), (0, 0, 180)])
def test_a_camera_that_is_turned_round_is_no_exchange(at_rest, turn_deg) -> None:
    turned = Rotation.from_rotvec(turn_deg, degrees=True).apply(at_rest)
    cause, cure = MarkerCheck(ROBOT).trouble(turned)
    assert cause.startswith("the camera is turned")
    assert "register" in cure


@pytest.mark.parametrize("scale", [0.5, 2.0, 1000.0])
def test_another_scale_is_another_robot(at_rest, scale) -> None:
    cause, _ = MarkerCheck(ROBOT).trouble(scale * at_rest)
    assert "not those of this robot" in cause
    assert "58.5 and 43.5 mm" in cause


@pytest.mark.parametrize("unit", ["metres", "centimetres"])
def test_a_tracker_that_gives_other_units_is_told(at_rest, unit) -> None:
    cause, cure = MarkerCheck(ROBOT).trouble(
        at_rest / {"metres": 1000.0, "centimetres": 10.0}[unit]
    )
    assert f"{unit} instead of mm would fit" in cause
    assert cure == "let the tracker give mm"


def test_the_lengths_are_not_blamed_for_a_marker_that_fitted_before(at_rest) -> None:
    check, stretched = MarkerCheck(ROBOT), at_rest + np.outer([0, 0, 1], [0, -20, 0])
    assert "the lengths in [robot]" in check.trouble(stretched)[1]
    assert check.accepts(Sample(0, at_rest))
    assert "which one came off, stands still" in check.trouble(stretched)[1]


def test_one_sample_that_does_not_fit_is_left_out_and_several_end_it(at_rest) -> None:
    check = MarkerCheck(ROBOT)
    wrong = at_rest[[2, 1, 0]]
    assert check.accepts(Sample(0, at_rest))
    assert not check.accepts(Sample(FRAME_US, wrong))
    assert check.accepts(Sample(2 * FRAME_US, at_rest))
    with pytest.raises(TrackerError, match="M1 and M3 have changed places"):
        for frame in range(3, 20):
            assert not check.accepts(Sample(frame * FRAME_US, wrong))
    assert frame < 12


def test_a_lost_marker_and_a_camera_that_is_moved_are_no_exchange(at_rest) -> None:
    check = MarkerCheck(ROBOT)
    lost = at_rest.copy()
    lost[1] = np.nan
    check.robot_moves()
    moved_mm = np.array((0, 58, 0))
    for frame, markers_mm in enumerate((at_rest, lost, at_rest + moved_mm, lost - moved_mm)):
        assert check.accepts(Sample(frame * FRAME_US, markers_mm))


def jumping(at_rest, frames: int, jumps) -> tuple[MarkerCheck, list[bool]]:
    """Pictures of a robot that moves slowly, of which some show its tip 40 mm elsewhere."""
    check = MarkerCheck(ROBOT)
    check.robot_moves()
    accepted = []
    for frame in range(frames):
        markers_mm = at_rest.copy()
        markers_mm[1:, 0] += np.array((0.5, 1.0)) * frame * 0.02
        markers_mm[2, 2] += 40.0 * bool(jumps(frame))
        accepted.append(check.accepts(Sample(frame * FRAME_US, markers_mm)))
    return check, accepted


@pytest.mark.parametrize("jumps", [lambda frame: frame % 10 == 5, lambda frame: frame == 7])
def test_a_picture_in_which_a_marker_jumps_is_left_out_and_counted(at_rest, jumps) -> None:
    check, accepted = jumping(at_rest, 100, jumps)
    assert accepted == [not jumps(frame) for frame in range(100)]
    assert check.jumped == accepted.count(False)


@pytest.mark.parametrize("every", [2, 3, 4])
def test_markers_that_jump_to_and_fro_end_the_run(at_rest, every) -> None:
    with pytest.raises(TrackerError, match="jump to and fro: 9 of the last"):
        jumping(at_rest, 100, lambda frame: frame % every == 1)


def test_a_robot_that_moves_as_far_is_believed_with_the_second_picture(at_rest) -> None:
    check, accepted = jumping(at_rest, 100, lambda frame: frame >= 50)
    assert accepted == [frame != 50 for frame in range(100)]
    assert check.jumped == 0


@pytest.mark.parametrize("moved", [slice(0, 1), slice(None)])
def test_a_base_or_camera_that_was_moved_ends_the_run_after_some_seconds(at_rest, moved) -> None:
    check = MarkerCheck(ROBOT)
    assert check.accepts(Sample(0, at_rest))
    check.robot_moves()
    elsewhere = at_rest.copy()
    elsewhere[moved] += np.array((10.0, 0.0, 0.0))
    for frame in range(1, 40):
        assert check.accepts(Sample(frame * FRAME_US, elsewhere if frame > 10 else at_rest))
    with pytest.raises(TrackerError, match="M1 is 10 mm from where it was: the camera, the robot"):
        for frame in range(40, 80):
            check.accepts(Sample(frame * FRAME_US, elsewhere))
    assert frame > 65


@pytest.mark.long
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_no_random_twin_is_refused_in_any_pose_and_exchanges_are_found_at_rest(seed) -> None:
    rng = np.random.default_rng(seed)
    description = schema.load(None, as_overrides(draw_twin(rng, ROBOT, 60.0)))
    camera = Rotation.from_rotvec(description.tracker.rotation_deg, degrees=True).as_matrix()
    robot = TwinRobot(description.twin)
    robot.advance_to(500_000)
    rest = robot.markers_mm() @ camera
    for order in NAMES:
        told = MarkerCheck(description).trouble(rest[list(order)])
        assert told is not None
        assert "exchanged" in told[0]
    check = MarkerCheck(description)
    for frame in range(1, 40):
        if frame % 5 == 1:
            angles_deg = rng.uniform(-60, 60, 2)
            robot.set_pulses_half_us(tuple(2 * (1500 + 1000 * angles_deg / 90)))
        robot.advance_to(500_000 + frame * FRAME_US)
        noise_mm = description.tracker.noise_mm / 6**0.5 * rng.standard_normal((3, 3))
        seen_mm = robot.markers_mm() @ camera + noise_mm
        assert check.trouble(seen_mm) is None
        # Motors that turn by 120 deg at once lead markers further than a picture may.
        check.accepts(Sample(frame * FRAME_US, seen_mm))
        check.robot_moves()
