from dataclasses import replace

import numpy as np
import pytest

from ccr_host.robot.rests import Rests

NO_MM = np.zeros((4, 3, 3))
TIME_S = np.array([1.0, 3.0, 4.0, 8.0])
START, HOME = np.array([0.3, -0.2]), np.zeros((4, 2))


def test_rests_in_turn_were_each_reached_from_the_one_before() -> None:
    q_rad = np.arange(8.0).reshape(4, 2)
    rests = Rests.in_turn(START, q_rad, NO_MM, np.ones(4))
    assert rests.from_rad == pytest.approx(np.vstack([START, q_rad[:-1]]))


def test_chosen_rests_remember_from_where_they_were_reached() -> None:
    rests = Rests.in_turn(START, np.arange(8.0).reshape(4, 2), NO_MM, np.ones(4))
    assert rests.chosen([2]).from_rad == pytest.approx(rests.q_rad[[1]])
    assert rests.last(1).from_rad == pytest.approx(rests.q_rad[[2]])
    assert rests.chosen([0]).then(rests.last(1)).from_rad == pytest.approx(rests.from_rad[[0, 3]])


@pytest.mark.parametrize(
    ("from_sides", "pairs"),
    [((1, -1, 1, -1), [0, 2]), ((1, 1, -1, 1), [1]), ((1, 1, 1, 1), []), ((0, 1, 0, -1), [])],
)
def test_two_rests_in_a_row_at_one_pose_reached_from_two_sides_are_a_pair(from_sides, pairs):
    from_rad = 0.2 * np.array(from_sides)[:, None] * np.ones(2)
    assert Rests(from_rad, HOME, NO_MM, np.ones(4), TIME_S).from_both_sides() == pairs


def test_merged_rests_stand_at_the_means_of_their_pairs() -> None:
    from_rad = 0.2 * np.array([[1.0], [1.0], [-1.0], [1.0]]) * np.ones(2)
    markers_mm = np.arange(36.0).reshape(4, 3, 3)
    merged = Rests(from_rad, HOME, markers_mm, np.ones(4), TIME_S).merged()
    assert merged.from_rad == pytest.approx(np.stack([from_rad[0], HOME[1], from_rad[3]]))
    assert merged.markers_mm == pytest.approx(
        np.stack([markers_mm[0], markers_mm[1:3].mean(axis=0), markers_mm[3]])
    )


def test_rests_of_different_poses_are_no_pair() -> None:
    q_rad = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.1, 0.0]])
    assert Rests(-q_rad, q_rad, NO_MM, np.ones(4), TIME_S).from_both_sides() == []


def test_motions_to_a_rest_share_its_time_by_their_lengths() -> None:
    q_rad = np.array([[0.0, 0.0], [0.4, 0.2], [0.4, 0.2], [0.0, 0.0]])
    from_rad = np.array([[0.1, 0.0], [0.3, 0.0], [0.4, 0.2], [0.0, 0.0]])
    durations_s = Rests(from_rad, q_rad, NO_MM, np.ones(4), TIME_S).durations_s()
    assert durations_s[1:] == pytest.approx(np.array([[1.2, 0.8], [0.0, 1.0], [4.0, 0.0]]))


def test_a_time_that_is_not_known_is_very_long() -> None:
    unknown = Rests.in_turn(START, np.arange(8.0).reshape(4, 2), NO_MM, np.ones(4))
    later = replace(unknown, time_s=TIME_S).then(unknown)
    very_long = later.durations_s().sum(axis=1) > 1e6
    assert very_long.tolist() == [True, False, False, False, True, True, True, True]


def test_stops_are_rests_and_where_motors_turned_back_on_their_way() -> None:
    q_rad = np.array([[0.1, 0.0], [0.3, 0.2], [0.3, 0.2], [0.0, 0.0]])
    from_rad = np.array([[0.0, 0.0], [0.1, 0.0], [0.5, 0.2], [0.3, 0.2]])
    stops_rad, rows = Rests(from_rad, q_rad, NO_MM, np.ones(4), TIME_S).stops()
    expected_rad = [[0.0, 0.0], [0.1, 0.0], [0.3, 0.2], [0.5, 0.2], [0.3, 0.2], [0.0, 0.0]]
    assert stops_rad.tolist() == expected_rad
    assert rows.tolist() == [1, 2, 4, 5]
