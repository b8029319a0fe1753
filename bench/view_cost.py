"""Cost of the live page for the control loop, and latency of its stop button.

``python -m bench.view_cost`` follows a path at 20 Hz in real time on the emulated board and the
twin, without a page, with a page without viewers, and with one that a viewer reads (a client that
receives everything like a browser, but draws nothing, so that its work does not count). It prints

- the lateness of the control periods relative to their grid (the loop's jitter);
- the CPU load of the loop, and of the page's process;
- the feed's process time for the frames, sample, command and record of one control step;
- the time from the press of the stop button to the stop request on the wire.

Needs the extra ``view``, and Linux for the load of the page's process. Other load on the machine
increases all figures.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table
from websockets.exceptions import ConnectionClosed

from ccr_host.control.base import Command, Outcome, Phase
from ccr_host.link.framing import FrameDecoder
from ccr_host.link.messages import Stop
from ccr_host.run.execute import execute, reference_of
from ccr_host.run.observer import Observers, RunObserver, RunSetup, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.tracking.tracker import Sample
from ccr_host.view.feed import PageOperator, SharedButtons
from ccr_host.view.live import LivePage, ViewAddress, live_page
from tests.viewer import Viewer

RATE_HZ = 20.0
PRESSES = 20
FRAMES_PER_STEP = 5
"""Two or three reports, a target and its reply."""
ARMS = ("no page", "page", "page and viewer")
COLUMNS = {
    "late_p50_us": "late, median (us)",
    "late_p99_us": "99 % (us)",
    "late_max_us": "maximum (us)",
    "loop_cpu_percent": "loop (% of a core)",
    "page_cpu_percent": "page (% of a core)",
    "kilobytes_per_s": "sent (kB/s)",
}


class Punctuality(RunObserver):
    """Records the end of each control period."""

    def __init__(self) -> None:
        self.ends_us: list[int] = []

    def step(self, record: StepRecord) -> None:
        self.ends_us.append(record.end_us)

    def lateness_us(self) -> np.ndarray:
        grid_us = 1e6 / RATE_HZ * np.arange(len(self.ends_us))
        late_us = np.array(self.ends_us) - grid_us
        return np.asarray(late_us - late_us.min())


def path_of(folder: Path, duration_s: float) -> str:
    """A path between two points well inside the workspace."""
    file = folder / "line.csv"
    file.write_text(f"t_s,y_mm,z_mm\n0,0,30\n{duration_s:g},10,35\n")
    return str(file)


def cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def look_on(url: str, bytes_read: Synchronized[float]) -> None:
    """Read everything that the page sends until it ends."""
    with Viewer(url) as looking, suppress(ConnectionClosed):
        while True:
            bytes_read.value += len(looking.receive())


@contextmanager
def viewer(page: LivePage) -> Iterator[Synchronized[float]]:
    """A viewer of the page; yields the number of bytes sent to it."""
    context = multiprocessing.get_context("spawn")
    bytes_read = context.Value("d", 0.0)
    process = context.Process(target=look_on, args=(page.url, bytes_read), daemon=True)
    process.start()
    time.sleep(3)
    try:
        yield bytes_read
    finally:
        process.terminate()


def measure(options: RunOptions, arm: str) -> dict[str, float]:
    """Execute one run."""
    punctuality = Punctuality()
    figures: dict[str, float] = {}

    def run(*onlookers: RunObserver) -> None:
        before_s, began = time.process_time(), time.perf_counter()
        execute(options, Observers((punctuality, *onlookers)), lambda *_: None)
        figures["seconds"] = time.perf_counter() - began
        figures["loop_cpu_percent"] = 100 * (time.process_time() - before_s) / figures["seconds"]

    if arm == "no page":
        run()
    else:
        with live_page(ViewAddress("127.0.0.1", 0), realtime=True) as page:
            (process,) = multiprocessing.active_children()
            assert process.pid is not None
            if arm == "page":
                before_s = cpu_s(process.pid)
                run(page.feed)
            else:
                with viewer(page) as bytes_read:
                    before_s, before_bytes = cpu_s(process.pid), bytes_read.value
                    run(page.feed)
                    sent = bytes_read.value - before_bytes
                figures["kilobytes_per_s"] = sent / 1000 / figures["seconds"]
            page_s = cpu_s(process.pid) - before_s
            figures["page_cpu_percent"] = 100 * page_s / figures["seconds"]
    for name, quantile in (("p50", 0.5), ("p99", 0.99), ("max", 1.0)):
        figures[f"late_{name}_us"] = float(np.quantile(punctuality.lateness_us(), quantile))
    return figures


def feed_us_per_step(options: RunOptions, steps: int = 2000) -> float:
    """Process time of the feed at 20 Hz, including the thread of its queue."""
    description, position = options.description(), np.zeros(3)
    record = StepRecord(
        0, 0, 0.0, position, np.zeros(2), Outcome.SOLVED, "", position[None], 1.0, False,
        position, 0, position,
    )  # fmt: skip
    command = Command(np.zeros(2), np.zeros((4, 3)), Outcome.SOLVED)
    sample = Sample(0, np.zeros((3, 3)))
    period_us = round(1e6 / RATE_HZ)
    with live_page(ViewAddress("127.0.0.1", 0), realtime=True) as page:
        page.feed.begin(RunSetup(options, description, reference_of(options)))
        before_s = time.process_time()
        for end_us in range(period_us, (steps + 1) * period_us, period_us):
            for _ in range(FRAMES_PER_STEP):
                page.feed.frame("received", end_us, bytes(32))
            page.feed.tracker_sample(end_us, sample)
            page.feed.control(end_us, None, command)
            page.feed.step(replace(record, end_us=end_us))
            time.sleep(0.0005)  # let the queue's thread run; sleeping costs no CPU time
        return 1e6 * (time.process_time() - before_s) / steps


class StopSeen(RunObserver):
    """Records the time at which the stop request is sent."""

    def __init__(self) -> None:
        self.decoder = FrameDecoder()
        self.following = threading.Event()
        self.sent_s: float | None = None

    def phase(self, time_us: int, phase: Phase) -> None:
        if phase.name.startswith("following"):
            self.following.set()

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        if direction == "sent" and any(f.id == Stop.ID for f in self.decoder.feed(data)):
            self.sent_s = time.perf_counter()


def stop_delay_us(options: RunOptions, wait_s: float) -> float:
    """Time from the button to the wire, with a controller without a tour."""
    options = replace(options, controller="mpc", checks="none")
    seen = StopSeen()
    buttons = SharedButtons(multiprocessing.get_context("spawn"))
    pressed: list[float] = []

    def press() -> None:
        seen.following.wait()
        time.sleep(wait_s)
        pressed.append(time.perf_counter())
        buttons.press_stop()

    thread = threading.Thread(target=press)
    thread.start()
    operator = PageOperator(buttons, lambda: True, deque())
    execute(options, Observers((seen,)), lambda *_: None, operator)
    thread.join()
    assert seen.sent_s is not None
    return 1e6 * (seen.sent_s - pressed[0])


def medians_of(runs: Sequence[dict[str, float]]) -> dict[str, float]:
    """Median of each figure over the runs of one arm."""
    return {key: float(np.median([run[key] for run in runs])) for key in runs[0]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of each run")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    with TemporaryDirectory() as folder:
        options = RunOptions(
            path_of(Path(folder), given.seconds),
            rate_hz=RATE_HZ,
            realtime=True,
            overrides=("control.settle_s=0.5",),
        )
        runs = [(arm, measure(options, arm)) for _ in range(given.rounds) for arm in ARMS]
        rng = np.random.default_rng(1)
        delays_us = [stop_delay_us(options, rng.uniform(0.1, 0.3)) for _ in range(PRESSES)]
        feed_us = feed_us_per_step(options)
    console = Console(width=120)
    table = Table(
        title=f"20 Hz in real time, medians of {given.rounds} runs of {given.seconds:g} s"
    )
    for heading in ("", *COLUMNS.values()):
        table.add_column(heading, justify="right")
    for arm in ARMS:
        figures = medians_of([run for name, run in runs if name == arm])
        cells = (f"{figures[key]:.1f}" if key in figures else "-" for key in COLUMNS)
        table.add_row(arm, *cells)
    console.print(table)
    console.print(f"feed: {feed_us:.0f} us of process time per control step")
    median_us, greatest_us = np.median(delays_us), max(delays_us)
    console.print(f"stop button to wire: median {median_us:.0f} us, maximum {greatest_us:.0f} us")


if __name__ == "__main__":
    main()
