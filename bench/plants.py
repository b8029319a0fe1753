"""All controllers on all shipped descriptions and on random plants, each plant with its limits.

    python -m bench.plants --out DIR [--twins N] [--robot NAME ...] [--rate HZ ...] [--seed N]
        [--path PATH ...] [--controller NAME ...] [--workers N]

Prints markdown tables, dated and with the version of the code. The random plants are those of
``ccr-host sweep`` with all effects, each on one of the paths; a shipped one is run on all of them.
All runs of a plant share its draw and seed, so the wins are paired. Beside the controllers stand:

- floor: the smallest error that the statics of the plant allow;
- feedforward: knows these statics, the servos and the delay (bench/limits.py), and has the better
  of two previews; it neglects friction and creep, and sees nothing;
- repeatability: RMS distance of the tip from its mean over visits to home, from all sides;
- change-overs of `adaptive`, servos that jump through their slack, and how many follow another one
  of the same servo within 2 s.

DIR holds a folder for each description; the same command continues a campaign that was interrupted.
"""

from __future__ import annotations

import argparse
import datetime
import json
import multiprocessing
import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.limits import KnowingFeedforward
from ccr_host.control.adaptive.law import AGAIN, CHANGES_OVER
from ccr_host.control.registry import baseline_names, controller_names
from ccr_host.core import __version__
from ccr_host.core.errors import CcrError
from ccr_host.core.user_file import replacing
from ccr_host.description.schema import Description
from ccr_host.description.source import shipped_descriptions
from ccr_host.record.folder import ResultFolder
from ccr_host.robot.paths import PAPER_PATHS
from ccr_host.run.execute import execute
from ccr_host.run.observer import Observers, RunObserver, StepRecord
from ccr_host.run.open_rig import open_rig
from ccr_host.run.rest_motion import visit
from ccr_host.tools.measured import Measured, home_of
from ccr_host.tools.record import stops_of
from ccr_host.tools.sweep.job import Row
from ccr_host.tools.sweep.plan import GivenTwin, SweepPlan, TwinJob
from ccr_host.tracking.markers.check import MarkerCheck

RANDOM = "random"
"""Name of the folder of random plants, and of their tables."""
JUDGED = "adaptive"
"""Compared with all others, run by run."""
REPEATABILITY, JUMPS = "repeatability.json", "change_overs.json"
HOME_PATTERNS = ("single", "pairs", "release")


class Ahead0(KnowingFeedforward):
    """Feedforward without preview."""

    preview = 0

    def __init__(self, description: Description) -> None:
        super().__init__(description, self.preview)


class Ahead1(Ahead0):
    """Feedforward with a preview of one step."""

    preview = 1


class Ahead3(Ahead0):
    """Feedforward with a preview of three steps."""

    preview = 3


class Ahead6(Ahead0):
    """Feedforward with a preview of six steps."""

    preview = 6


FEEDFORWARD = [
    f"{os.path.relpath(__file__)}:{kind.__name__}" for kind in (Ahead0, Ahead1, Ahead3, Ahead6)
]
_SLOW_HZ = 5.0


def previews_of(rate_hz: float) -> list[str]:
    """The feedforwards worth a run: at a low rate one step is longer than all delays."""
    return FEEDFORWARD[:2] if rate_hz < _SLOW_HZ else FEEDFORWARD[2:]


def repeatability_mm(job: TwinJob) -> float | None:
    """RMS distance of the true tip from its mean over visits to home; None if it cannot be had."""
    options = job.options(job.drives[0])
    description = options.description()
    stops = stops_of(description, HOME_PATTERNS, rests=1, seed=job.base.seed)
    kept: list[int] = []
    tips_mm: list[np.ndarray] = []
    try:
        with open_rig(options, description, Observers()) as rig:

            def note(number: int, _: np.ndarray) -> None:
                tip_mm = rig.true_tip_mm()
                if tip_mm is not None:
                    kept.append(number)
                    tips_mm.append(tip_mm)

            visit(rig, MarkerCheck(description), stops.q_rad, lambda *_: None, note)
    except CcrError:
        return None
    tip_mm = np.array(tips_mm).reshape(-1, 3)
    time_s, pattern = np.array(kept, dtype=float), np.array(stops.pattern)[kept]
    below_mm = np.empty((len(kept), 0, 3))
    home = home_of(Measured(time_s, stops.q_rad[kept], "rad", tip_mm, below_mm, pattern))
    return None if home is None else home.rms_mm


class _Details(RunObserver):
    """Collects what is told of commands along the path."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def step(self, record: StepRecord) -> None:
        self.told.append(record.detail)


def change_overs(job: TwinJob) -> dict[str, tuple[int, int]]:
    """Change-overs of `adaptive`, and those soon after another one, by rate.

    It is run once more for that: a new column would make folders of earlier sweeps unreadable.
    """
    counts = {}
    for rate_hz in {rate_hz for rate_hz, _ in job.drives}:
        seen = _Details()
        execute(job.options((rate_hz, JUDGED)), seen, lambda *_: None)
        told = ", ".join(seen.told)
        counts[f"{rate_hz:g}"] = told.count(CHANGES_OVER), told.count(CHANGES_OVER + AGAIN)
    return counts


def of_plants(
    file: Path, jobs: Sequence[TwinJob], find: Callable[[TwinJob], Any], workers: int | None
) -> dict[int, Any]:
    """What is found about plants, by their number; kept in a file, and not found again."""
    known = json.loads(file.read_text()) if file.exists() else {}
    unknown = [job for job in jobs if str(job.index) not in known]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for job, found in zip(unknown, pool.map(find, unknown), strict=True):
            known[str(job.index)] = found
            with replacing(file) as draft:
                draft.write_text(json.dumps(known))
    return {job.index: known[str(job.index)] for job in jobs}


class Results(NamedTuple):
    """What is known of some plants."""

    rows: list[Row]
    """One for each run."""
    repeatability_mm: dict[int, float | None]
    """Keys are the numbers of the plants, here and below."""
    change_overs: dict[int, dict[str, tuple[int, int]]]


def run_all(plan: SweepPlan, jobs: Sequence[TwinJob], out: Path, workers: int | None) -> Results:
    """Run what is not in the folder.

    Raises:
        CcrError: workers cannot run, or the folder is not of this campaign.
    """
    from ccr_host.tools.sweep.store import SweepFolder
    from ccr_host.tools.sweep.workers import run_missing

    with ResultFolder(out, out.name) as folder:
        store = SweepFolder(folder.path, plan)
        runs, done = sum(len(job.drives) for job in jobs), [0]

        def count(finished: int) -> None:
            done[0] += finished
            print(f"{out.name}: {done[0]} of {runs} runs", file=sys.stderr, flush=True)

        run_missing(store, jobs, workers, None, count)
        repeatability = of_plants(folder.path / REPEATABILITY, jobs, repeatability_mm, workers)
        jumps = of_plants(folder.path / JUMPS, jobs, change_overs, workers)
        wanted = {(job.index, *drive) for job in jobs for drive in job.drives}
        rows = [r for r in store.rows() if (r["index"], r["rate_hz"], r["controller"]) in wanted]
    return Results(rows, repeatability, jumps)


def errors_of(rows: Sequence[Row], repeatability: dict[int, float | None]) -> dict[str, dict]:
    """Mean true error of each controller and limit by plant, mm; without results left out."""
    errors: dict[str, dict[int, float]] = defaultdict(dict)
    for row in rows:
        index, error_mm = row["index"], row["true_mean_error_mm"]
        if row["twin_floor_mean_error_mm"] is not None:
            errors["floor"][index] = row["twin_floor_mean_error_mm"]
        if error_mm is None or row["fault"]:
            continue
        name = row["controller"]
        if name in FEEDFORWARD:
            error_mm = min(error_mm, errors["feedforward"].get(index, np.inf))
            name = "feedforward"
        errors[name][index] = error_mm
    errors["repeatability"] = {i: mm for i, mm in repeatability.items() if mm is not None}
    return errors


def print_table(
    title: str, rows: Sequence[Row], repeatability: dict[int, float | None], names: Sequence[str]
) -> None:
    """One table: random plants by their distribution, the three of a shipped one by path."""
    errors = errors_of(rows, repeatability)
    path_of = {row["index"]: row["path"] for row in rows}
    by_path = not title.startswith(RANDOM)
    figures = list(path_of.values()) if by_path else ["median", "95 %", "largest"]
    heads = ["", "plants", *figures, "diverged", f"{JUDGED} is better"]
    print(f"\n| {title} | " + " | ".join(heads[1:]) + " |\n" + "|---" * len(heads) + "|")
    for name in [*names, "feedforward", "floor", "repeatability"]:
        of = errors[name]
        if by_path:
            values = [of.get(index, np.nan) for index in path_of]
        else:
            values = list(np.percentile([*of.values()], (50, 95, 100))) if of else [np.nan] * 3
        mm = ["" if np.isnan(value) else f"{value:.2f}" for value in values]
        diverged, wins = "", ""
        if name in names:
            diverged = str(sum(r["diverged"] for r in rows if r["controller"] == name))
            both = [index for index in of if index in errors[JUDGED]]
            if name != JUDGED and both:
                won = sum(errors[JUDGED][index] < of[index] for index in both)
                wins = f"{won} of {len(both)}"
        print(f"| {name} | {len(of)} | {' | '.join(mm)} | {diverged} | {wins} |", flush=True)


def code_version() -> str:
    """Version of the package, and the commit if this is a checkout of it."""
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    described = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return f"ccr-host {__version__}" + (f", {described}" if described else "")


def noted_version(out: Path) -> str:
    """All versions that have run this campaign, kept in its folder."""
    file = out / "versions.txt"
    versions = file.read_text().splitlines() if file.exists() else []
    if code_version() not in versions:
        versions.append(code_version())
        out.mkdir(parents=True, exist_ok=True)
        file.write_text("".join(f"{version}\n" for version in versions))
    return "; ".join(versions)


def main() -> None:
    """Run what is missing, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--twins", type=int, default=100)
    parser.add_argument("--robot", nargs="*", default=shipped_descriptions())
    parser.add_argument("--rate", type=float, nargs="+", default=[1.0, 20.0])
    parser.add_argument("--path", nargs="+", default=PAPER_PATHS)
    parser.add_argument("--controller", nargs="+", default=[*controller_names(), *baseline_names()])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"  # the worker processes inherit it
    paths, names = tuple(arguments.path), arguments.controller
    drives = [(rate, name) for rate in arguments.rate for name in [*names, *previews_of(rate)]]
    campaigns = [
        (
            name,
            SweepPlan(arguments.seed, paths, name, twins=(GivenTwin({}),) * len(paths)),
            len(paths),
        )
        for name in arguments.robot
    ]
    if arguments.twins:
        campaigns.append((RANDOM, SweepPlan(arguments.seed, paths), arguments.twins))
    try:
        version = noted_version(arguments.out)
        print(f"{datetime.date.today()}, {version}; seed {arguments.seed}; mean true error, mm")
        for title, plan, count in campaigns:
            jobs = plan.jobs(range(count), drives)
            found = run_all(plan, jobs, arguments.out / title, arguments.workers)
            for rate_hz in arguments.rate:
                of_rate = [row for row in found.rows if row["rate_hz"] == rate_hz]
                print_table(f"{title}, {rate_hz:g} Hz", of_rate, found.repeatability_mm, names)
                jumps, again = np.array([n[f"{rate_hz:g}"] for n in found.change_overs.values()]).T
                print(
                    f"\nChange-overs of {JUDGED}: {np.median(jumps):g} a run in the median, "
                    f"{jumps.max()} at most; within 2 s of another: {again.sum()} in "
                    f"{len(again)} runs, {again.max()} at most"
                )
    except CcrError as error:
        raise SystemExit(f"bench.plants: {error}") from None


if __name__ == "__main__":
    main()
