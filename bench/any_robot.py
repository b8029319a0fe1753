"""Controllers on random robots of 1 to 4 planar or spatial segments, on paths within reach.

    python -m bench.any_robot --out DIR [--robots 100] [--rate HZ ...] [--controller NAME ...]
        [--set KEY=VALUE] [--workers 2]

The robot is hanging, and has the faults of the shipped ``default``; what bends is as stiff as its
length and mass ask for; ``--set`` changes all of them. The path is what the model's tip does while
all motors swing smoothly. DIR keeps the descriptions, the paths and a line for each run; the same
command continues, and repeats the robots in progress.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Robot, Segment, Tendon
from ccr_host.description.source import text_and_encoding_of, tree_of
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.run.execute import execute_quietly
from ccr_host.run.observer import true_errors_mm
from ccr_host.run.options import RunOptions
from ccr_host.run.twin_floor import twin_floor_mm
from ccr_host.tools.sweep.job import LOST_MM

MOST_BENDING_RAD = 1.2
"""Greatest bending of each segment on the path."""
DURATION_S = 60.0
RESULTS = "runs.jsonl"
CONTROLLERS = ["mpc", "mpc-offset", "pid-ik", "adaptive"]
JUDGED = "adaptive"


def random_robot(
    rng: np.random.Generator,
    segments: int,
    *,
    lengths_mm: tuple[float, float] = (20.0, 150.0),
    radii_mm: tuple[float, float] = (2.0, 15.0),
) -> Robot:
    """Planar segments with a pair of tendons, spatial ones with two pairs or three tendons."""
    motors = 0
    described = []
    for _ in range(segments):
        kind = rng.choice(["plane", "pairs", "three"])
        direction_deg = float(rng.uniform(-180, 180))
        pulls: list[Tendon] = []
        for part in range({"plane": 1, "pairs": 2, "three": 3}[kind]):
            motors += 1
            apart_deg = 120.0 * part if kind == "three" else 90.0 * part
            angle_deg = direction_deg + apart_deg + float(rng.uniform(-20, 20))
            pulls.append(Tendon(angle_deg=_turn(angle_deg), motor=motors))
            if kind != "three":
                opposite = _turn(angle_deg + 180.0)
                pulls.append(Tendon(angle_deg=opposite, motor=motors, winding=-1))
        described.append(
            Segment(
                length_mm=float(rng.uniform(*lengths_mm)),
                tendon_radius_mm=float(rng.uniform(*radii_mm)),
                bends="plane" if kind == "plane" else "space",
                direction_deg=_turn(direction_deg),
                tendons=tuple(pulls),
            )
        )
    return Robot(
        segments=tuple(described),
        marker_offset_mm=float(rng.uniform(0, 40)),
        pulley_radius_mm=float(rng.uniform(3, 20)),
    )


def built(rng: np.random.Generator, segments: int) -> Robot:
    """A random robot of a size that can be built, hanging, with pulleys that suit its tendons."""
    robot = random_robot(rng, segments, lengths_mm=(30.0, 80.0), radii_mm=(3.0, 8.0))
    widest_mm = max(segment.tendon_radius_mm for segment in robot.segments)
    hanging = {"gravity_direction": (0.0, -1.0, 0.0), "pulley_radius_mm": 2.0 * widest_mm}
    return robot.model_copy(update=hanging)


def _turn(angle_deg: float) -> float:
    return (angle_deg + 180.0) % 360.0 - 180.0


def description_text(robot: Robot) -> str:
    """The robot with the faults of `default`, as TOML."""
    faults = dict(tree_of(text_and_encoding_of(None)[0])["twin"])
    del faults["servo_neutral_us"]
    reach_mm = sum(segment.length_mm for segment in robot.segments)
    faults["bending_stiffness_nm_rad"] = 0.02 * (reach_mm / 100.0) ** 2
    faults["tendon_force_max_n"] = 200.0
    return tomlkit.dumps({"robot": robot.model_dump(exclude_unset=True), "twin": faults})


def path_text(robot: Robot, rng: np.random.Generator) -> str:
    """A closed path that the tip makes while all motors swing, as a path file."""
    model = ConstantCurvature(robot)
    time_s = np.linspace(0.0, DURATION_S, 601)
    turns = rng.integers(1, 4, model.motors)
    phases = rng.uniform(0.0, 2.0 * np.pi, model.motors)
    swings = np.sin(2.0 * np.pi * turns * time_s[:, None] / DURATION_S + phases)
    bending = np.abs(model.bending_rad(swings)).max()
    tip_mm = model.tip_mm(MOST_BENDING_RAD / bending * swings)
    rows = [f"{t:.2f},{x:.4f},{y:.4f},{z:.4f}" for t, (y, x, z) in zip(time_s, tip_mm, strict=True)]
    return "\n".join(["t_s,x_mm,y_mm,z_mm", *rows, ""])


def judged(
    robot: int, folder: Path, overrides: tuple[str, ...], runs: list[tuple[float, str]]
) -> list[dict[str, Any]]:
    """Figures of one robot's runs, each a rate in Hz and a controller; a rate has one floor."""
    description, path = str(folder / f"{robot}.toml"), str(folder / f"{robot}.csv")
    floors_mm: dict[float, float | None] = {}
    rows: list[dict[str, Any]] = []
    for rate_hz, controller in runs:
        options = RunOptions(
            robot=description,
            path=path,
            overrides=overrides,
            controller=controller,
            rate_hz=rate_hz,
            seed=robot,
            checks="none",
        )
        rows.append({"robot": robot, "controller": controller, "rate_hz": rate_hz})
        try:
            rows[-1]["motors"] = options.description().robot.motors
            result = execute_quietly(options)
            errors_mm = true_errors_mm(result.records)
            if result.failure is not None or errors_mm is None:
                rows[-1]["failure"] = str(result.failure)
                continue
            if rate_hz not in floors_mm:
                floors_mm[rate_hz] = twin_floor_mm(result.options, result.reference)
        except CcrError as error:
            rows[-1]["failure"] = str(error)
            continue
        off_mm = np.linalg.norm(errors_mm, axis=1)
        rows[-1] |= {
            "mean_mm": float(off_mm.mean()),
            "end_mm": float(off_mm[-len(off_mm) // 4 :].mean()),
            "max_mm": float(off_mm.max()),
            "floor_mm": floors_mm[rate_hz],
        }
    return rows


def print_table(rows: list[dict[str, Any]]) -> None:
    """One line for each controller and rate."""
    print(f"| rate | controller | robots | failed | diverged | {JUDGED} better |", end="")
    print(" mean true error: median, mm | 95 % | greatest | above the floor | 95 % | greatest |")
    print("|---" * 12 + "|")
    means = {(r["rate_hz"], r["controller"], r["robot"]): r.get("mean_mm") for r in rows}
    for rate_hz, controller in sorted({(row["rate_hz"], row["controller"]) for row in rows}):
        mine = [r for r in rows if (r["rate_hz"], r["controller"]) == (rate_hz, controller)]
        done = [row for row in mine if "mean_mm" in row]
        diverged = sum(row["end_mm"] > (row["floor_mm"] or 0.0) + LOST_MM for row in done)
        pairs = [(row["mean_mm"], means.get((rate_hz, JUDGED, row["robot"]))) for row in done]
        better = sum(judged_mm is not None and judged_mm < mm for mm, judged_mm in pairs)
        columns: list[object] = [f"{rate_hz:g} Hz", controller, len(mine), len(mine) - len(done)]
        columns += [diverged, "" if controller == JUDGED else better]
        errors_mm = [row["mean_mm"] for row in done]
        above_mm = [row["mean_mm"] - row["floor_mm"] for row in done if row["floor_mm"] is not None]
        for of_mm in (errors_mm, above_mm):
            columns += [f"{mm:.2f}" for mm in np.percentile(of_mm or [np.nan], (50, 95, 100))]
        print("| " + " | ".join(map(str, columns)) + " |")


def main() -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--rate", type=float, nargs="+", default=[1.0, 20.0])
    parser.add_argument("--controller", nargs="+", default=CONTROLLERS)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    kept, overrides = arguments.out / RESULTS, tuple(arguments.overrides)
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    done = {(row["robot"], row["rate_hz"], row["controller"]) for row in rows}
    os.environ["OMP_NUM_THREADS"] = "1"  # the worker processes inherit it
    with ProcessPoolExecutor(arguments.workers) as pool:
        jobs = []
        for robot in range(1, arguments.robots + 1):
            rng = np.random.default_rng(robot)
            described = built(rng, 1 + robot % 4)
            (arguments.out / f"{robot}.toml").write_text(description_text(described))
            (arguments.out / f"{robot}.csv").write_text(path_text(described, rng))
            runs = [(rate, name) for rate in arguments.rate for name in arguments.controller]
            runs = [run for run in runs if (robot, *run) not in done]
            jobs.append(pool.submit(judged, robot, arguments.out, overrides, runs))
        for job in as_completed(jobs):
            rows += job.result()
            with kept.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in job.result())
    print_table(rows)


if __name__ == "__main__":
    main()
