"""Latency budget of the Polaris driver: from an exposure to the sample, and its CPU time.

``python bench/tracker_latency.py`` prints

- the time to parse one reply (3 strays and the dummy tool, as in every run);
- in virtual time on a 115200 baud line: the age of a sample when the driver has it, its components,
  and the error of the time of exposure;
- in real time on a pseudo-terminal: the rate and the driver's CPU load (process time of this
  process minus that of an idle clock; the emulated camera runs in another process).
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from multiprocessing.connection import Connection

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from ccr_host.core.clock import Parts, RealClock, VirtualClock
from ccr_host.core.wire import crc16_arc
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.line import make_polaris
from ccr_host.sim.polaris.sensor import BitOrder, StrayList, ToolLine, format_tx
from ccr_host.sim.serving.ports import PtyPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tracking.sources.ndi.driver import NdiTracker
from ccr_host.tracking.sources.ndi.port import SerialPort
from ccr_host.tracking.sources.ndi.replies import decode_reply, parse_tx
from ccr_host.tracking.tracker import wait_until_tracking
from tests.exposer import Exposer, running

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])
LATENCY_MS = 40.0
EXPOSURE_PERIOD_US = 50_000
PARSES = 20_000
PARSE_LIMIT_US = 200.0

Array = NDArray[np.float64]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="duration of each run")
    seconds = parser.parse_args().seconds
    console = Console()
    table = Table("figure", "median", "p99", "max", title="Polaris driver")
    parse_us = time_of_parsing()
    row(table, "parse one reply, us", parse_us, 1)
    ages_ms, errors_ms = virtual_run(seconds)
    row(table, "age of a new sample, ms", ages_ms, 2)
    row(table, "  of which camera (configured), ms", np.full(1, LATENCY_MS), 1)
    row(table, "  of which poll and wire, ms", ages_ms - LATENCY_MS, 2)
    row(table, "error of the time of exposure, ms", errors_ms, 2)
    console.print(table)
    rate_hz, share, idle = real_run(seconds)
    console.print(f"on a pty in real time: {rate_hz:.2f} frames/s")
    console.print(
        f"share of a core: {100 * share:.2f} % with the driver, {100 * idle:.2f} % for the clock "
        f"alone, so {100 * (share - idle):.2f} % for the driver"
    )
    verdict = "met" if np.median(parse_us) < PARSE_LIMIT_US else "MISSED"
    console.print(f"parsing below {PARSE_LIMIT_US:g} us median: {verdict}")


def row(table: Table, name: str, values: Array, digits: int) -> None:
    """Add the distribution of a figure."""
    figures = (np.median(values), np.percentile(values, 99), values.max())
    table.add_row(name, *(f"{figure:.{digits}f}" for figure in figures))


def time_of_parsing() -> Array:
    """Time for CRC, grammar and numbers of a typical reply, us."""
    strays = StrayList(MARKERS_MM - (0, 0, 900), np.ones(3, dtype=bool))
    tools = [ToolLine(1, 0x31, 300)]
    text = format_tx(0x1801, tools, strays, 0, BitOrder.FIRST_IS_HIGHEST).encode()
    line = b"%s%04X" % (text, crc16_arc(text))
    times_us = []
    for _ in range(PARSES):
        start_ns = time.perf_counter_ns()
        parse_tx(decode_reply(line))
        times_us.append((time.perf_counter_ns() - start_ns) / 1000)
    return np.array(times_us)


def virtual_run(seconds: float) -> tuple[Array, Array]:
    """Ages of new samples, and errors of their times of exposure, ms."""
    line = make_polaris(Tracker(latency_ms=LATENCY_MS), np.random.SeedSequence(1))
    clock = VirtualClock()
    tracker = NdiTracker("ndi-emulator:", lambda: line)
    for part in (Exposer(line.device.sensor, lambda _: MARKERS_MM), line, tracker):
        clock.attach(part)
    ages_ms, errors_ms = [], []
    with running(tracker):
        wait_until_tracking(tracker, clock)
        clock.sleep_until_us(clock.now_us() + 2_000_000)
        end_us = clock.now_us() + round(seconds * 1e6)
        last = tracker.newest_frame()
        while clock.now_us() < end_us:
            clock.sleep_until_us(clock.now_us() + 1000)
            frame = tracker.newest_frame()
            if frame is not last and frame is not None:
                last = frame
                true_us = round(frame.exposed_us / EXPOSURE_PERIOD_US) * EXPOSURE_PERIOD_US
                ages_ms.append((clock.now_us() - true_us) / 1000)
                errors_ms.append(abs(frame.exposed_us - true_us) / 1000)
    return np.array(ages_ms), np.array(errors_ms)


def real_run(seconds: float) -> tuple[float, float, float]:
    """Frames per second, and CPU load with and without the driver."""
    ours, theirs = multiprocessing.Pipe()
    camera = multiprocessing.Process(target=serve_camera, args=(theirs,), daemon=True)
    camera.start()
    path = str(ours.recv()).partition(":")[2]
    try:
        idle_clock = RealClock()
        idle = share_of_core(idle_clock, seconds)
        clock = RealClock()
        tracker = NdiTracker(f"ndi:{path}", lambda: SerialPort(path))
        clock.attach(tracker)
        with running(tracker):
            wait_until_tracking(tracker, clock)
            before = tracker.health.frames
            share = share_of_core(clock, seconds)
            return (tracker.health.frames - before) / seconds, share, idle
    finally:
        camera.terminate()
        camera.join()


def share_of_core(clock: RealClock, seconds: float) -> float:
    """Process time over wall time while the clock waits."""
    start_s = time.process_time()
    clock.sleep_until_us(clock.now_us() + round(seconds * 1e6))
    return (time.process_time() - start_s) / seconds


def serve_camera(pipe: Connection) -> None:
    """Serve the emulated camera in another process until it is terminated."""
    line = make_polaris(Tracker(latency_ms=LATENCY_MS), np.random.SeedSequence(1))
    world = Parts()
    world.attach(line)
    world.attach(Exposer(line.device.sensor, lambda _: MARKERS_MM))
    server = BoardServer(line, PtyPort(), RealClock(), world=world)
    pipe.send(server.uri)
    server.run()


if __name__ == "__main__":
    main()
