"""Memory, files and timing of long runs: ``python -m bench.endurance virtual`` or ``realtime``.

``virtual``: 24 h of path at 1 Hz on the emulated board and the twin in virtual time, with its log.
``realtime``: 8 minutes at 20 Hz in real time, with log and live page.

It samples the process's resident memory and open files along the path, and prints the slope of
memory over the second half of the run, the missed and skipped steps, the lateness of the periods,
and the messages missing in the log. All records of a run stay in memory for figure and summary,
about 2.5 kB per step. Needs Linux; ``realtime`` needs the extra ``view``.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

from ccr_host.core.clock import wall_ns
from ccr_host.record.keep import execute_logged
from ccr_host.run.observer import RunObserver, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import summarise
from ccr_host.view.live import live_page, parse_view_address

LAP_S = 80
SAMPLES = 200
"""Samples of memory and open files along a run."""


class Usage(RunObserver):
    """Observes memory and open files of this process, and the end of each period."""

    def __init__(self, steps: int, period_s: float) -> None:
        self._every = max(1, steps // SAMPLES)
        self._period_us = period_s * 1e6
        self.at_step: list[int] = []
        self.resident_kb: list[int] = []
        self.open_files: list[int] = []
        self.late_us: list[float] = []

    def step(self, record: StepRecord) -> None:
        """Sample at a step."""
        self.late_us.append(record.end_us - record.step * self._period_us)
        if record.step % self._every == 0:
            self.at_step.append(record.step)
            self.resident_kb.append(_resident_kb())
            self.open_files.append(len(list(Path("/proc/self/fd").iterdir())))

    def slope_bytes_per_step(self) -> float:
        """Slope of resident memory over the second half, when all caches are warm."""
        half = len(self.at_step) // 2
        slope, _ = np.polyfit(self.at_step[half:], self.resident_kb[half:], 1)
        return float(slope) * 1024


def _resident_kb() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    raise OSError("no VmRSS in /proc/self/status")


def measure(options: RunOptions, *, with_page: bool) -> Table:
    """Execute a run and observe it."""
    steps = round(options.laps * LAP_S * options.rate_hz)
    usage = Usage(steps, 1.0 / options.rate_hz)
    start_ns = wall_ns()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        onlookers: list[RunObserver] = [usage]
        if with_page:
            address = parse_view_address("127.0.0.1:0")
            page = stack.enter_context(live_page(address, realtime=options.realtime))
            onlookers.append(page.feed)
        result = execute_logged(options, folder, lambda *_: None, onlookers)
        log_mb = sum(file.stat().st_size for file in folder.glob("*.mcap")) / 1e6
    summary = summarise(result)
    late_ms = (np.array(usage.late_us) - min(usage.late_us)) / 1000.0
    middle = len(usage.resident_kb) // 2
    table = Table(title=f"{options.controller}, {options.rate_hz:g} Hz", title_justify="left")
    table.add_column("")
    table.add_column("", justify="right")
    rows = {
        "steps": f"{summary['steps']} of {steps}",
        "ended by": str(result.failure or "the end of the path"),
        "wall time": f"{(wall_ns() - start_ns) * 1e-9:.0f} s",
        "memory at the first step, half-way, at the end": " / ".join(
            f"{usage.resident_kb[at] / 1024:.0f}" for at in (0, middle, -1)
        )
        + " MiB",
        "slope over the second half": f"{usage.slope_bytes_per_step():.0f} bytes a step",
        "open files at the first step, most, at the end": " / ".join(
            str(n) for n in (usage.open_files[0], max(usage.open_files), usage.open_files[-1])
        ),
        "missed deadlines, of them skipped": f"{summary['missed_deadlines']}, "
        f"{summary['skipped_steps']}",
        "holds and relaxes of the board": f"{summary['board_holds']}, {summary['board_relaxes']}",
        "periods end late by: median, 99 %, most": " / ".join(
            f"{value:.1f}" for value in (*np.quantile(late_ms, [0.5, 0.99]), late_ms.max())
        )
        + " ms",
        "mean error": f"{summary['mean_error_mm']:.2f} mm",
        "log": f"{log_mb:.0f} MB; missing: {result.log_trouble or 'nothing'}",
    }
    for row in rows.items():
        table.add_row(*row)
    return table


def main() -> None:
    """Command line of the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=["virtual", "realtime"])
    parser.add_argument("--hours", type=float, default=24.0, help="duration of the path, virtual")
    parser.add_argument("--minutes", type=float, default=8.0, help="duration of the path, realtime")
    parser.add_argument("--controller", default="adaptive")
    words = parser.parse_args()
    realtime = words.kind == "realtime"
    path_s = words.minutes * 60.0 if realtime else words.hours * 3600.0
    options = RunOptions(
        path="ellipse",
        controller=words.controller,
        rate_hz=20.0 if realtime else 1.0,
        laps=max(1, round(path_s / LAP_S)),
        realtime=realtime,
    )
    Console().print(measure(options, with_page=realtime))


if __name__ == "__main__":
    main()
