"""The live page in its own process: many before it, and what becomes of the run when it dies."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import Event, Thread
from typing import Any, cast

import numpy as np
import pytest

from ccr_host.control.base import Command, Outcome, Phase
from ccr_host.core.errors import CcrError
from ccr_host.record.keep import execute_logged
from ccr_host.run.execute import reference_of
from ccr_host.run.observer import RunSetup, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.view.live import LivePage, ViewAddress, live_page
from tests.patience import becomes_true
from tests.viewer import Viewer

VIEWERS = 60
ADDRESS = ViewAddress("127.0.0.1", 0)


@pytest.fixture
def page() -> Iterator[LivePage]:
    """The page of a run that goes on for as long as the test."""
    options, over = RunOptions("8shape"), Event()
    with live_page(ADDRESS, realtime=True) as page:
        setup = RunSetup(options, options.description(), reference_of(options))
        page.feed.begin(setup)
        page.feed.phase(0, Phase("following the path"))
        run = Thread(target=make_steps, args=(page, over))
        run.start()
        yield page
        over.set()
        run.join()


def make_steps(page: LivePage, over: Event) -> None:
    here, step = np.zeros(3), 0
    while not over.wait(0.02):
        step += 1
        page.feed.step(
            StepRecord(
                step, step * 20_000, step * 0.02, here, np.zeros(2), Outcome.SOLVED, "",
                here[None], 1.0, False, here, 0, here,
            )
        )  # fmt: skip
        page.feed.event(step * 20_000, "")


def process_of(page: LivePage) -> int:
    number = page._process.pid
    assert number is not None
    return number


def kill(page: LivePage) -> None:
    number = process_of(page)
    os.kill(number, signal.SIGKILL)
    assert becomes_true(lambda: process_of(page) != number or not page._keeper.is_alive())


def is_told(page: LivePage, text: str, heard: list[str]) -> bool:
    """Whether this is among the news so far."""
    heard.append(page.operator.news())
    return any(text in news for news in heard)


def hear(viewer: Viewer, over: Event) -> None:
    while not over.is_set():
        viewer.hear()


@pytest.mark.long
def test_sixty_viewers_at_once_neither_end_the_page_nor_take_its_stop(page: LivePage) -> None:
    number, over = process_of(page), Event()
    with ExitStack() as stack, ThreadPoolExecutor(VIEWERS) as crowd:
        viewers = [stack.enter_context(one) for one in crowd.map(Viewer, [page.url] * VIEWERS)]
        hearing = [crowd.submit(hear, viewer, over) for viewer in viewers]
        time.sleep(5)
        over.set()
        for one in hearing:
            one.result()
        viewers[-1].press("STOP the robot")
        assert becomes_true(lambda: page.operator.wants_stop)
    assert process_of(page) == number
    assert page.operator.news() == ""


@pytest.mark.long
def test_a_page_that_dies_is_told_and_comes_back_under_the_same_address(
    page: LivePage, capfd: pytest.CaptureFixture[str]
) -> None:
    with Viewer(page.url) as viewer:
        viewer.press("Pause")
        assert becomes_true(lambda: page.operator.wants_pause)
    kill(page)
    assert page.operator.wants_pause, "the pause outlives the page, as somebody can end it"
    assert "the live page has died (SIGKILL) and is started again" in page.operator.news()
    assert page.operator.news() == ""
    assert "ccr-host: the live page has died (SIGKILL)" in capfd.readouterr().err
    with Viewer(page.url) as viewer:
        viewer.press("Continue")
        assert becomes_true(lambda: not page.operator.wants_pause)
        viewer.press("STOP the robot")
        assert becomes_true(lambda: page.operator.wants_stop)


@pytest.mark.long
def test_a_page_that_hangs_is_replaced_and_one_that_is_only_slow_is_not(
    page: LivePage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ccr_host.view.live._SILENT_S", 20.0)
    number, heard = process_of(page), list[str]()
    os.kill(number, signal.SIGSTOP)
    time.sleep(2.0)
    os.kill(number, signal.SIGCONT)
    assert not is_told(page, "hangs", heard)
    os.kill(number, signal.SIGSTOP)
    assert becomes_true(lambda: is_told(page, "the live page hangs and is started again", heard))
    assert becomes_true(lambda: process_of(page) != number)
    with Viewer(page.url) as viewer:
        viewer.press("STOP the robot")
        assert becomes_true(lambda: page.operator.wants_stop)


@pytest.mark.long
def test_a_page_that_cannot_be_kept_is_given_up_which_ends_a_pause(
    page: LivePage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ccr_host.view.live._MOST_STARTS", 2)
    page._buttons.set_pause(True)
    kill(page)
    kill(page)
    heard: list[str] = []
    assert becomes_true(lambda: is_told(page, "stays away; only Ctrl-C in the terminal", heard))
    with pytest.raises(CcrError, match="page ended during a pause"):
        _ = page.operator.wants_pause


@pytest.mark.long
def test_what_cannot_be_drawn_is_told_once_and_leaves_the_buttons(page: LivePage) -> None:
    number = process_of(page)
    with Viewer(page.url) as viewer:
        viewer.control("STOP the robot")
        nowhere = Command(np.zeros(2), cast(Any, None), Outcome.SOLVED)
        page.feed.control(1_000_000_000, None, nowhere)
        page.feed.event(1_000_000_000, "")
        heard: list[str] = []
        assert becomes_true(lambda: is_told(page, "the live page: drawing has failed", heard))
        time.sleep(0.5)
        assert page.operator.news() == ""
        viewer.press("STOP the robot")
        assert becomes_true(lambda: page.operator.wants_stop)
    assert process_of(page) == number


@pytest.mark.long
def test_a_page_that_dies_after_its_run_comes_back_as_its_player(tmp_path: Path) -> None:
    (tmp_path / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,30\n2,10,35\n")
    options = RunOptions(str(tmp_path / "short.csv"), "mpc")
    with live_page(ADDRESS, realtime=False) as page:
        execute_logged(options, tmp_path / "kept", lambda *_: None, [page.feed], page.operator)
        page.end_run(tmp_path / "kept")
        kill(page)
        with Viewer(page.url) as viewer:
            viewer.press("Play")
            viewer.control("Pause")
            assert "STOP the robot" not in viewer.labels


@pytest.mark.long
def test_a_page_that_does_not_start_says_why_in_its_error_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "viser.py").write_text("raise ImportError('viser is broken')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    told = "the live page did not start: ImportError: viser is broken"
    with pytest.raises(CcrError, match=told), live_page(ADDRESS, realtime=True):
        pytest.fail("nothing is shown")
    assert capfd.readouterr() == ("", "")
