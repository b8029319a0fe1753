"""What is seen live is what is played afterwards."""

from pathlib import Path

import numpy as np
import pytest

from ccr_host.control.base import Phase
from ccr_host.description import schema
from ccr_host.record.keep import execute_logged
from ccr_host.record.log.reader import play_run
from ccr_host.run.execute import reference_of
from ccr_host.run.observer import RunSetup
from ccr_host.run.options import RunOptions
from ccr_host.tracking.tracker import Sample
from ccr_host.view.history import Moment, RunHistory
from ccr_host.view.page import legend_html, status_html


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunHistory, RunHistory]:
    """A run as it was seen, and as its folder plays it."""
    folder: Path = tmp_path_factory.mktemp("run")
    path = folder / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    seen, played = RunHistory(), RunHistory()
    execute_logged(RunOptions(str(path), "mpc"), folder, lambda *_: None, [seen])
    path.unlink()
    play_run(folder, played)
    return seen, played


def assert_equal(left: Moment, right: Moment) -> None:
    np.testing.assert_allclose(left.horizon_mm, right.horizon_mm, atol=1e-3)  # rounded in the log
    for name in ("time_us", "phase", "markers_mm", "markers_age_us", "link"):
        np.testing.assert_equal(getattr(left, name), getattr(right, name), err_msg=name)
    np.testing.assert_equal(left.trail_mm, right.trail_mm)
    np.testing.assert_equal(left.steps._asdict(), right.steps._asdict())
    assert (left.board is None) == (right.board is None)
    if left.board is not None and right.board is not None:
        np.testing.assert_equal(left.board._asdict(), right.board._asdict())


def test_a_played_run_is_the_one_that_was_seen(run: tuple[RunHistory, RunHistory]) -> None:
    seen, played = run
    assert seen.end_us == played.end_us
    for time_us in np.linspace(0, seen.end_us, 50):
        assert_equal(seen.at(time_us), played.at(time_us))


def test_a_moment_knows_nothing_of_what_comes_later(run: tuple[RunHistory, RunHistory]) -> None:
    history, _ = run
    for time_us in np.linspace(0, history.end_us, 50):
        moment = history.at(time_us)
        assert (moment.steps.end_us <= time_us).all()
        assert len(moment.trail_mm) == len(moment.steps.end_us)
        assert moment.board is None or moment.board.time_us <= time_us
        assert moment.link is None or moment.link.time_us <= time_us
        assert np.isnan(moment.markers_age_us) or moment.markers_age_us >= 0


def test_the_phases_of_a_run_follow_each_other(run: tuple[RunHistory, RunHistory]) -> None:
    history, _ = run
    moments = map(history.at, np.linspace(0, history.end_us, 500))
    phases = list(dict.fromkeys(moment.phase.name for moment in moments if moment.phase))
    wanted = ["arming", "approaching the first point", "following the path", "disarming"]
    assert [phase for phase in phases if phase in wanted] == wanted
    assert history.at(history.end_us).phase == Phase("done")


def test_the_status_tells_board_step_and_error(run: tuple[RunHistory, RunHistory]) -> None:
    history, _ = run
    assert history.setup is not None
    moment = history.at(history.end_us)
    text = status_html(history.setup, moment, dropped_batches=7)
    assert "disarmed" in text
    assert "no pulses" in text
    assert "6 of 6" in text
    assert f"{moment.steps.error_mm[-1]:.2f} mm" in text
    assert "7 updates left out" in text
    assert "7 updates" not in status_html(history.setup, moment)
    assert "not heard yet" in status_html(history.setup, history.at(-1))


def test_markers_that_have_not_been_seen_for_long_are_not_shown() -> None:
    history = RunHistory()
    description = schema.load()
    options = RunOptions("8shape")
    history.begin(RunSetup(options, description, reference_of(options)))
    history.tracker_sample(1_000_000, Sample(960_000, np.eye(3)))
    history.tracker_sample(1_100_000, Sample(1_060_000, np.full((3, 3), np.nan)))
    stale_us = description.control.stale_after_ms * 1000
    assert history.at(1_000_000 + stale_us).markers_mm is not None
    late = history.at(1_000_001 + stale_us)
    assert late.markers_mm is None
    assert history.setup is not None
    assert "no markers for 0.3 s" in status_html(history.setup, late)


def test_the_legend_names_the_ends_of_the_scale() -> None:
    options = RunOptions("8shape")
    setup = RunSetup(options, schema.load(), reference_of(options))
    assert "7.5 or more" in legend_html(7.5, setup)
