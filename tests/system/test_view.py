"""The live page in a real browser, without a screen."""

import os
import re
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import sync_playwright

from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from tests.patience import PATIENCE_S
from tests.system.conftest import (
    IN_REAL_TIME,
    PAPERS,
    CcrHost,
    children,
    events,
    logged,
    wait_until_following,
)
from tests.system.warm_start import PipedProgram

# A machine without a graphics card draws in software, as slowly as it likes.
PATIENCE_MS = 1000 * PATIENCE_S
# Each picture takes half a second of CPU, nearly all of it for filling areas that no test looks at.
FEW_PICTURES = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), 1000);
window.cancelAnimationFrame = clearTimeout;
for (const context of [WebGLRenderingContext, WebGL2RenderingContext])
  for (const name of ["drawArrays", "drawElements"])
    context.prototype[name] = context.prototype[name + "Instanced"] = () => {};
"""
LIVE = (
    *("track", "8shape", *PAPERS, *IN_REAL_TIME, "--laps", "9", "--realtime", "--no-open"),
    *("--out", "kept", "--view", "127.0.0.1:0"),
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path=shutil.which("chromium"),  # None: what `playwright install` brought
            args=[
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--ignore-gpu-blocklist",
                "--no-sandbox",
            ],
        )
        yield chromium
        chromium.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    page = browser.new_page(viewport={"width": 900, "height": 400})
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(FEW_PICTURES)
    yield page
    page.close()


def address_in(process: PipedProgram) -> str:
    """The first address that the command prints for a browser."""
    for line in process.stderr:
        found = re.search(r"http://\S+", line)
        if found:
            return found[0].rstrip(";")
    pytest.fail("no address was printed")


@contextmanager
def ended(process: PipedProgram, number: signal.Signals) -> Iterator[None]:
    try:
        yield
    finally:
        if process.poll() is None:
            process.send_signal(number)
        process.communicate(timeout=PATIENCE_S)


def test_pause_continue_and_stop_reach_the_robot(
    ccr_host: CcrHost, tab: Any, tmp_path: Path
) -> None:
    board = ccr_host.start("emulate", "--tcp", "127.0.0.1:0", "--boot-ms", "0")
    with ended(board, signal.SIGTERM):
        uri = board.stdout.readline().split()[3].rstrip(";")
        run = ccr_host.start(
            *LIVE, "--device", uri, "--rate", "5",
        )  # fmt: skip
        with ended(run, signal.SIGINT):
            tab.goto(address_in(run))
            tab.get_by_text("following the path").wait_for()
            tab.get_by_role("button", name="Pause").click()
            tab.get_by_text("paused").wait_for()
            assert tab.get_by_text("active").is_visible(), "held under the watchdog"
            tab.get_by_role("button", name="Continue").click()
            tab.get_by_text("following the path").wait_for()
            tab.get_by_role("button", name="STOP the robot").click()
            _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130
    assert "stopped by the operator" in err
    assert "Traceback" not in err
    recording = RunRecording(tmp_path / "kept")
    sent = [message.content["name"] for message in recording.messages(topics.SENT)]
    assert "set_target" in sent[: sent.index("stop")]
    assert not {"set_target", "disarm"} & set(sent[sent.index("stop") :])
    reports = list(recording.messages(topics.STATE))
    assert reports[-1].content["state"] == "stopped"
    assert reports[-1].content["pulse_half_us"] == [0, 0], "at the pins, not only by the state"
    events = {m.content["message"]: m.time_us for m in recording.messages(topics.EVENT)}
    steps_us = [message.time_us for message in recording.messages(topics.STEP)]
    paused_us, on_us = events["paused"], events["following the path"]
    assert not [at_us for at_us in steps_us if paused_us < at_us < on_us]
    during = {m.content["state"] for m in reports if paused_us < m.time_us < on_us}
    assert "active" in during
    assert during <= {"active", "hold"}, "the watchdog is fed; a busy computer may be late"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[CcrHost, str]:
    """A run that had a page but nobody before it, for a script."""
    ccr_host = CcrHost(tmp_path_factory.mktemp("recorded"))
    (ccr_host.folder / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    run = ccr_host(
        "track",
        "short.csv",
        *PAPERS,
        *IN_REAL_TIME,
        "--no-open",
        "--out",
        "kept",
        "--json",
        "--view",
        "127.0.0.1:0",
    )
    assert run.status == 0, "it ends with the run"
    assert run.summary["steps"] == 6
    return ccr_host, run.err


def test_a_script_reads_the_summary_alone(recorded: tuple[CcrHost, str]) -> None:
    assert "live page: http://127.0.0.1:" in recorded[1]


CHARTS = "Object.values(window.__viserTestpoints.uplots).map(({chart}) => "


def test_a_recorded_run_is_shown_as_ended_played_and_scrubbed(
    recorded: tuple[CcrHost, str], tab: Any
) -> None:
    player = recorded[0].start("view", "kept", "--address", "127.0.0.1:0")
    with ended(player, signal.SIGINT):
        tab.goto(address_in(player))
        tab.get_by_text("6 of 6").wait_for()
        tab.get_by_text("done", exact=True).wait_for()
        assert not tab.get_by_role("button", name="STOP").is_visible(), "there is nothing to stop"
        assert not tab.get_by_role("checkbox", name="ideal robot").is_checked()

        tab.wait_for_function(CHARTS + "chart.data[0].length).filter(n => n > 2).length >= 4")
        spans = tab.evaluate(CHARTS + "[chart.scales.x.min, chart.scales.x.max])")
        assert len(spans) == 5
        assert [*spans[0]] == [0, 30]
        assert all(span == spans[0] for span in spans), "all plots have one time axis"

        slider = tab.get_by_role("slider").first
        slider.focus()
        slider.press("Home")
        tab.get_by_text("0 of 6").wait_for()
        tab.get_by_role("button", name="Play").click()
        tab.get_by_text(re.compile(r"^[1-6] of 6")).wait_for()
    assert player.returncode == 0


def test_a_run_outlives_the_process_of_its_page_and_the_browser_finds_the_next(
    ccr_host: CcrHost, tab: Any, tmp_path: Path
) -> None:
    run = ccr_host.start(*LIVE)
    with ended(run, signal.SIGINT):
        tab.goto(address_in(run))
        tab.get_by_text("following the path").wait_for()
        (page,) = children(run.pid)
        os.kill(page, signal.SIGKILL)
        assert "ccr-host: the live page has died (SIGKILL)" in run.stderr.readline()
        tab.get_by_text("following the path").wait_for()
        tab.get_by_role("button", name="STOP the robot").click()
        run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130
    assert any("the live page has died (SIGKILL)" in event for event in events(tmp_path / "kept"))


def test_a_stop_in_the_terminal_works_though_the_page_is_gone(
    ccr_host: CcrHost, tmp_path: Path
) -> None:
    run = ccr_host.start(*LIVE)
    with ended(run, signal.SIGINT):
        wait_until_following(tmp_path / "kept", run)
        os.kill(*children(run.pid), signal.SIGSTOP)
        run.send_signal(signal.SIGINT)
        _, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 130
    assert err.endswith("ccr-host: interrupted\n")
    assert logged(tmp_path / "kept", topics.STATE)[-1]["state"] == "disarmed"


@pytest.mark.parametrize("address", ["nowhere", "192.0.2.1:80"])
def test_an_address_that_cannot_be_had_is_one_line(
    ccr_host: CcrHost, short_path: str, address: str
) -> None:
    run = ccr_host("track", short_path, *PAPERS, "--no-open", f"--view={address}")
    assert run.status == 2
    assert run.err.startswith("ccr-host: error: ")
    assert address in run.err
    assert len(run.err.splitlines()) == 1


def test_a_folder_without_a_run_is_one_line(ccr_host: CcrHost) -> None:
    viewed = ccr_host("view", "nowhere")
    assert viewed.status == 2
    assert "nowhere" in viewed.err
    assert len(viewed.err.splitlines()) == 1
