"""Runs per minute of ``ccr-host sweep`` on this machine, and the CPU time of the parts of a run.

    python bench/sweep_throughput.py [--twins N] [--workers N ...]

Each twin takes four runs (1 and 20 Hz, ``adaptive`` and ``mpc``). CPU seconds are reproducible on a
busy machine; runs per minute need an idle one.
"""

from __future__ import annotations

import argparse

import numpy as np

from ccr_host.core.clock import wall_ns
from ccr_host.robot.paths import PAPER_PATHS
from ccr_host.tools.sweep.job import Row
from ccr_host.tools.sweep.plan import SweepPlan
from ccr_host.tools.sweep.workers import local_workers, run_jobs

DRIVES = [(rate_hz, name) for rate_hz in (1.0, 20.0) for name in ("adaptive", "mpc")]
PARTS = ("twin", "emulator", "controller", "rest")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", type=int, default=6)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    jobs = SweepPlan(seed=1, paths=PAPER_PATHS).jobs(range(arguments.twins), DRIVES)
    rows: list[Row] = []
    for workers in arguments.workers:
        with local_workers(workers) as client:
            start_ns = wall_ns()
            rows = [row for of_a_twin in run_jobs(client, jobs) for row in of_a_twin]
            minutes = (wall_ns() - start_ns) * 1e-9 / 60
        print(f"{workers} workers: {len(rows) / minutes:.1f} runs per minute")
    print_costs(rows)


def print_costs(rows: list[Row]) -> None:
    """Print median CPU seconds of a run by controller and rate."""
    print("| Hz | controller | CPU s per run |", *(f"{part} |" for part in PARTS))
    print("|---" * (3 + len(PARTS)) + "|")
    for rate_hz, name in DRIVES:
        group = [r for r in rows if (r["rate_hz"], r["controller"]) == (rate_hz, name)]
        seconds = [
            np.median([row[column] for row in group])
            for column in ("cpu_s", *(f"cpu_{part}_s" for part in PARTS))
        ]
        print(f"| {rate_hz:g} | {name} |", *(f"{s:.2f} |" for s in seconds))


if __name__ == "__main__":
    main()
