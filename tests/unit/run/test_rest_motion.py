"""A tour of rests on the emulated board and the twin."""

import numpy as np
import pytest

from ccr_host.core.errors import TrackerError
from ccr_host.link.messages import State, StateReport
from ccr_host.robot.rests import Rests
from ccr_host.run.observer import Observers, RunObserver
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.run.rest_motion import RestError, visit
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

REST_DEG = (20.0, -10.0)
OPTIONS = RigOptions(overrides=(f"servo.rest_deg={[*REST_DEG]}", "twin.joint_damping=4e-3"))
STOPS_RAD = np.radians([(30.0, 0.0), (30.0, 15.0)])


@pytest.fixture
def check() -> MarkerCheck:
    return MarkerCheck(OPTIONS.description())


class Witness(RunObserver):
    """Keeps what the board says of itself."""

    def __init__(self) -> None:
        self.reports: list[StateReport] = []

    def state(self, time_us: int, report: StateReport) -> None:
        self.reports.append(report)


def test_a_tour_tells_where_it_began_and_ends_there_disarmed(check: MarkerCheck) -> None:
    witness = Witness()
    with open_rig(OPTIONS, OPTIONS.description(), witness) as rig:
        tour = visit(rig, check, STOPS_RAD, lambda *_: None)
        assert rig.client.read_state().state is State.DISARMED
    np.testing.assert_allclose(np.degrees(tour.from_rad[0]), REST_DEG, atol=0.01)
    np.testing.assert_allclose(tour.q_rad, STOPS_RAD)
    active = [report for report in witness.reports if report.state is State.ACTIVE]
    np.testing.assert_allclose(active[-1].target_cdeg, np.multiply(REST_DEG, 100), atol=1)


def test_progress_is_told_before_each_pose_and_at_the_end(check: MarkerCheck) -> None:
    told = []
    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        visit(rig, check, STOPS_RAD, lambda done, poses: told.append((done, poses)))
    assert told == [(0, 2), (1, 2), (2, 2)]


def test_poses_without_markers_are_left_out_and_the_tour_goes_on(
    monkeypatch, check: MarkerCheck
) -> None:
    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        seen = rig.tracker.newest
        blind = {"now": False}
        monkeypatch.setattr(rig.tracker, "newest", lambda: None if blind["now"] else seen())
        tour = visit(rig, check, STOPS_RAD, lambda done, _: blind.update(now=done == 0))
        assert rig.client.read_state().state is State.DISARMED
    np.testing.assert_allclose(tour.q_rad, STOPS_RAD[1:])


@pytest.mark.parametrize(("moving", "measured"), [({0, 1, 3}, [2, 4]), ({1, 2, 3}, None)])
def test_poses_in_which_the_robot_does_not_rest_are_left_out_but_not_three_in_turn(
    monkeypatch, check: MarkerCheck, moving: set[int], measured: list[int] | None
) -> None:
    stops_rad = np.radians([(deg, 0.0) for deg in (10.0, 20.0, 30.0, 20.0, 10.0)])
    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        seen, pose = rig.tracker.newest, [0]

        def drifting() -> Sample | None:
            sample = seen()
            if sample is None or pose[0] not in moving:
                return sample
            drift_mm = 1e-6 * (sample.exposed_us % 9_000_000) * np.eye(3)[2][:, None]
            return Sample(sample.exposed_us, sample.markers_mm + drift_mm)

        monkeypatch.setattr(rig.tracker, "newest", drifting)

        def tour() -> Rests:
            return visit(rig, check, stops_rad, lambda done, _: pose.__setitem__(0, done))

        if measured is None:
            with pytest.raises(RestError, match="does not come to rest"):
                tour()
            assert pose == [3]
        else:
            np.testing.assert_allclose(tour().q_rad, stops_rad[measured])


def test_an_interrupted_tour_leaves_no_servo_powered(check: MarkerCheck) -> None:
    def interrupt(done: int, _: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    witness = Witness()
    with (
        pytest.raises(KeyboardInterrupt),
        open_rig(OPTIONS, OPTIONS.description(), witness) as rig,
    ):
        visit(rig, check, STOPS_RAD, interrupt)
    assert any(report.state is State.ACTIVE for report in witness.reports)
    assert witness.reports[-1].state is State.DISARMED
    assert witness.reports[-1].pulse_half_us == (0, 0)


def test_a_tracker_that_repeats_one_picture_with_new_stamps_ends_the_tour(
    monkeypatch, check: MarkerCheck
) -> None:
    stops_rad = np.radians([(deg, 0.0) for deg in (0.0, 15.0, 30.0, 45.0, 30.0, 0.0, 0.0)])
    told = []
    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        seen, first = rig.tracker.newest, []

        def repeated() -> Sample | None:
            if (sample := seen()) is None:
                return None
            first.append(sample.markers_mm)
            return Sample(sample.exposed_us, first[0])

        monkeypatch.setattr(rig.tracker, "newest", repeated)
        with pytest.raises(TrackerError, match="repeats one picture"):
            visit(rig, check, stops_rad, lambda done, _: told.append(done))
    assert told[-1] == 4
