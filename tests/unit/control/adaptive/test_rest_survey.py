from collections.abc import Collection

import numpy as np
import pytest

from ccr_host.control.adaptive.identification import RestSurvey
from ccr_host.control.shell import Measurement, median_of_seen, smooth_moves
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory

TICK_S = 0.05
START = np.array([0.1, 0.0])
STOPS = np.array([[0.5, 0.3], [0.3, 0.1], [0.1, -0.1], [0.3, 0.1], [-0.4, 0.2]])
REST_S = np.array([0.0, 0.5, 0.0, 0.5, 0.5])


def surveyed(hidden_at: Collection[int] = ()) -> Rests:
    """A tour at 20 Hz, the tip at the setpoint's angles; on some moves it is hidden to the end."""
    history, survey = SetpointHistory(START), RestSurvey(START)
    survey.visit(STOPS)
    ends = [len(smooth_moves(START, STOPS[:n], REST_S[:n], TICK_S)) for n in range(1, 6)]
    for tick, setpoint_rad in enumerate(smooth_moves(START, STOPS, REST_S, TICK_S)):
        time_s = tick * TICK_S
        if int(np.searchsorted(ends, tick)) not in hidden_at:
            seen = np.append(history.at(time_s), time_s)
            survey.add(
                history,
                Measurement(seen[None], time_s, time_s, history.at(time_s), None, None, TICK_S),
            )
        history.command(time_s, setpoint_rad, TICK_S)
    return survey.rests()


def test_a_pose_reached_from_two_sides_is_two_rests_and_passed_stops_are_none() -> None:
    rests = surveyed()
    assert rests.q_rad == pytest.approx(np.vstack([START, STOPS[[1, 3, 4]]]))
    assert rests.from_rad == pytest.approx(np.vstack([START, STOPS[[0, 2, 3]]]))
    assert rests.tip_mm[:, :2] == pytest.approx(rests.q_rad)
    assert (np.diff(rests.tip_mm[:, 2]) > 0.0).all()
    assert rests.from_both_sides() == [1]
    moves_s = [
        (len(smooth_moves(START, STOPS[:n], REST_S[:n], TICK_S)) - 1) * TICK_S for n in (2, 4)
    ]
    assert np.diff(rests.time_s[1:3]) == pytest.approx(np.diff(moves_s), abs=TICK_S)


@pytest.mark.parametrize(("hidden", "seen"), [({1}, [3, 4]), ({3}, [1, 4]), ({1, 3}, [4])])
def test_a_rest_that_is_not_seen_does_not_change_from_where_the_others_were_reached(hidden, seen):
    rests = surveyed(hidden)
    assert rests.q_rad[1:] == pytest.approx(STOPS[seen])
    assert rests.from_rad[1:] == pytest.approx(STOPS[[n - 1 for n in seen]])


def test_each_end_is_the_median_of_the_pictures_that_show_it() -> None:
    ends_mm = np.arange(36.0).reshape(4, 3, 3)
    ends_mm[0, 1], ends_mm[3, 1, 2], ends_mm[:, 0] = np.nan, np.nan, np.nan
    found_mm = median_of_seen(ends_mm)
    assert np.isnan(found_mm[0]).all()
    assert found_mm[1] == pytest.approx(ends_mm[1:3, 1].mean(axis=0))
    assert found_mm[2] == pytest.approx(ends_mm[1:3, 2].mean(axis=0))


def test_a_robot_that_is_never_seen_has_no_rests() -> None:
    rests = surveyed(range(6))
    assert rests.q_rad.shape == rests.from_rad.shape == (0, 2)
    assert rests.tip_mm.shape == (0, 3)
