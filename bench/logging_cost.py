"""Cost of the log: computing time with control steps at 1 kHz, and disk space at 20 Hz.

``python bench/logging_cost.py`` follows a path on the twin at 1 kHz in virtual time and records the
calls of an observer. It then repeats them to the log in real time, with the log's writer thread
running, and measures:

- per step: processor time of the control thread within the log's observer and for recording the
  inputs (mean; the longest 1 % also by the wall clock, which includes waiting for the interpreter);
- CPU load: processor time of the whole process, including the writer thread, above that of the same
  loop without the log; the minimum of three, as other load on the machine only adds to it.

The size of 24 h is extrapolated from a run in real time at 20 Hz with all its telemetry.
"""

from __future__ import annotations

import argparse
import math
import platform
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rich.console import Console
from rich.table import Table

from ccr_host.record.keep import execute_logged
from ccr_host.record.log.run_log import open_run_log
from ccr_host.run.execute import execute
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RunOptions
from ccr_host.run.recording import TOKENS_WITH_TIME, Tape

Call = tuple[int, str, tuple[Any, ...]]
"""Time, us, method of the observer, arguments."""

FAST_HZ = 1000.0
SLOW_HZ = 20.0
DAY_S = 86_400
_CHUNK_INDEX_BYTES = 81
_REPEATS = 3
_BUDGET_US = 50
_BUDGET_OF_CORE = 0.05
_BUDGET_GB = 2.0


class Remembering(RunObserver):
    """Records every call; those without a time get that of the previous one."""

    def __init__(self) -> None:
        self.calls: list[Call] = []

    def __getattribute__(self, name: str) -> Any:
        if name.startswith("_") or name == "calls":
            return super().__getattribute__(name)

        def keep(*words: Any) -> None:
            time_us = self.calls[-1][0] if self.calls else 0
            if words and isinstance(words[0], int):
                time_us = words[0]
            elif name == "frame":
                time_us = words[1]
            elif name == "step":
                time_us = words[0].end_us
            self.calls.append((time_us, name, words))

        return keep


def recorded_calls(seconds: float, folder: Path) -> list[Call]:
    """Calls of a run at ``FAST_HZ`` in virtual time, from the first step on, after the setup."""
    remembering = Remembering()
    options = RunOptions(_circle(folder, seconds), controller="mpc", rate_hz=FAST_HZ)
    execute(options, remembering, lambda *_: None)
    calls = remembering.calls
    begin = next(call for call in calls if call[1] == "begin")
    first = next(i for i, call in enumerate(calls) if call[1] == "step")
    last = max(i for i, call in enumerate(calls) if call[1] == "step")
    return [begin, *calls[first : last + 1]]


def play(calls: list[Call], observer: RunObserver | None) -> tuple[float, float, list[float]]:
    """Repeat calls at their original pace.

    Returns:
        Processor time of the process and wall time, s; wall time of the calls of each ms, us.
    """
    bound: list[tuple[int, Callable[..., None] | None, tuple[Any, ...]]] = [
        (time_us, getattr(observer, name) if observer else None, words)
        for time_us, name, words in calls[1:]
    ]
    start_us = calls[1][0]
    spent_us: list[float] = []
    index = 0
    cpu_s, start_ns = time.process_time(), time.monotonic_ns()
    while index < len(bound):
        time.sleep(0.001)
        now_us = start_us + (time.monotonic_ns() - start_ns) // 1000
        while index < len(bound) and bound[index][0] <= now_us:
            tick_us, tick_start_ns = bound[index][0], time.perf_counter_ns()
            while index < len(bound) and bound[index][0] <= tick_us:
                _, method, words = bound[index]
                if method is not None:
                    method(*words)
                index += 1
            spent_us.append((time.perf_counter_ns() - tick_start_ns) / 1000)
    wall_s = (time.monotonic_ns() - start_ns) * 1e-9
    return time.process_time() - cpu_s, wall_s, spent_us


def control_thread_us(calls: list[Call], folder: Path, steps: int) -> float:
    """Processor time of the calling thread per step, with the writer thread beside it."""
    with open_run_log(folder, realtime=True) as log:
        log.begin(*calls[0][2])
        start_s = time.thread_time()
        for _, name, words in calls[1:]:
            getattr(log, name)(*words)
        return (time.thread_time() - start_s) * 1e6 / steps


def tape_us(calls: list[Call], steps: int) -> float:
    """Processor time per step to record the host's inputs, which are then logged."""
    pieces = [words[0] for _, name, words in calls if name == "inputs"]
    tape = Tape(lambda _: None)
    start_s = time.thread_time()
    for piece in pieces:
        times_us = iter(piece.times_us)
        for token in piece.tokens:
            if token in TOKENS_WITH_TIME:
                tape.at(token, next(times_us))
            else:
                tape.note(token)
    return (time.thread_time() - start_s) * 1e6 / steps


def day_gb(seconds: float, folder: Path) -> tuple[float, float]:
    """Size of 24 h at ``SLOW_HZ``, GB, and of one second, KB; without the start."""
    options = RunOptions(_circle(folder, seconds), rate_hz=SLOW_HZ, realtime=True)
    run = folder / "slow"
    run.mkdir()
    result = execute_logged(options, run, lambda *_: None)
    if result.failure is not None:
        raise result.failure
    first_ns = (result.records[0].end_us + 1_000_000) * 1000
    last_ns = result.records[-1].end_us * 1000
    size = 0
    for path in run.glob("*.mcap"):
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        for chunk in summary.chunk_indexes:
            if first_ns <= chunk.message_start_time < last_ns:
                own_index = _CHUNK_INDEX_BYTES + 10 * len(chunk.message_index_offsets)
                size += chunk.chunk_length + chunk.message_index_length + own_index
    per_second = size / ((last_ns - first_ns) * 1e-9)
    return per_second * DAY_S * 1e-9, per_second * 1e-3


def _circle(folder: Path, seconds: float) -> str:
    """Write a path file: a loop of 20 s."""
    path = folder / "circle.csv"
    rows = ["t_s,y_mm,z_mm"]
    for t in np.arange(0.0, seconds + 0.05, 0.1):
        angle = 2 * math.pi * t / 20
        rows.append(f"{t:.1f},{15 * math.sin(angle):.4f},{30 + 10 * math.cos(angle):.4f}")
    path.write_text("\n".join(rows) + "\n")
    return str(path)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="duration at 1 kHz")
    parser.add_argument(
        "--slow-seconds", type=float, default=60.0, help="duration in real time at 20 Hz"
    )
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        calls = recorded_calls(words.seconds, folder)
        steps = sum(call[1] == "step" for call in calls)
        thread_us = control_thread_us(calls, folder, steps) + tape_us(calls, steps)
        shares, spent_us = [], []
        for _ in range(_REPEATS):
            idle_s, idle_wall_s, _ = play(calls, None)
            with open_run_log(folder, realtime=True) as log:
                log.begin(*calls[0][2])
                busy_s, busy_wall_s, spent = play(calls, log)
            shares.append(busy_s / busy_wall_s - idle_s / idle_wall_s)
            spent_us += spent
        of_core = min(shares)
        gb, kb_s = day_gb(words.slow_seconds, folder)
    median, p99, longest = np.quantile(spent_us, [0.5, 0.99, 1.0])
    table = Table(title=f"Logging, {platform.machine()}, Python {platform.python_version()}")
    for column in ("figure", "measured", "budget"):
        table.add_column(column)
    table.add_row("control thread, processor time per 1 kHz step", f"{thread_us:.1f} us",
                  f"{_BUDGET_US} us")  # fmt: skip
    table.add_row("same by the wall clock: median / p99 / longest",
                  f"{median:.0f} / {p99:.0f} / {longest:.0f} us", "")  # fmt: skip
    table.add_row(f"whole process at 1 kHz ({steps} steps)", f"{of_core:.2%} of a core",
                  f"{_BUDGET_OF_CORE:.0%}")  # fmt: skip
    table.add_row("24 h at 20 Hz", f"{gb:.2f} GB ({kb_s:.1f} KB/s)", f"{_BUDGET_GB} GB")
    Console().print(table)


if __name__ == "__main__":
    main()
