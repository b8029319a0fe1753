"""Checks the deviations stated by register, calibrate and setup, which make the same survey.

    python -m bench.survey --robots 100 --workers 2 [--first 1] [--out survey]

Random robots: every effect of ``ccr-host sweep``'s random twins and its wrong belief of their
geometry; servos off by up to 10 deg and reversed or not, any rotation of the camera, friction of
each tendon up to 0.3 N. One tour each in virtual time; its rests are kept in the folder, one line
per robot, so that the same command continues a campaign and fits again what was measured.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import CcrError
from ccr_host.description import schema
from ccr_host.robot.rests import Rests
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools.survey import survey_rests
from ccr_host.tools.survey_fit import fit_survey
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin

NAMES = ("camera about x", "camera about y", "camera about z", "zero of motor 1", "zero of motor 2")
ZERO_DEG, FRICTION_N, SCALE_US = 10.0, 0.3, 1000.0
TOUR_S = 155.0
"""Duration of a tour, to within 5 s; servos drift meanwhile."""
Array = NDArray[np.float64]


def drawn(seed: int) -> dict[str, Any]:
    """Keys of a random robot, and of the description that is believed."""
    rng = np.random.default_rng(seed)
    keys = draw_twin(rng, schema.load(), TOUR_S)
    del keys["twin.push"]
    zeros_deg = rng.uniform(-ZERO_DEG, ZERO_DEG, 2)
    axis = rng.normal(size=3)
    rotation_deg = rng.uniform(0.0, 180.0) * axis / np.linalg.norm(axis)
    return keys | {
        "twin.servo_neutral_us": (1500.0 + zeros_deg * SCALE_US / 90.0).round(2).tolist(),
        "twin.servo_us_per_90_deg": rng.choice([-SCALE_US, SCALE_US], 2).tolist(),
        "tracker.rotation_deg": rotation_deg.round(3).tolist(),
        "twin.friction": round(float(rng.uniform(0.0, FRICTION_N)), 4),
    }


def true_zeros_deg(keys: Mapping[str, Any]) -> Array:
    """Angles commanded where the tendons of a pair have the same slack, on average over the tour.

    Half the difference in slack of a pair and the drift of a servo act like an error of its zero.
    """
    neutral_us, slack_mm = (
        np.array(keys[f"twin.{key}"]) for key in ("servo_neutral_us", "slack_mm")
    )
    share = TOUR_S / keys["twin.servo_drift_time_s"]
    drift_deg = np.array(keys["twin.servo_drift_deg"]) * (1.0 + np.expm1(-share) / share)
    skew_rad = (slack_mm[:2] - slack_mm[2:]) / (2.0 * keys["twin.pulley_radius_mm"])
    shaft_deg = np.degrees(skew_rad) - drift_deg
    direction = np.sign(keys["twin.servo_us_per_90_deg"])
    zeros: Array = (neutral_us - 1500.0) * 90.0 / SCALE_US + direction * shaft_deg
    return zeros


def measured(out: Path, seed: int) -> None:
    """Make the tour of a robot, unless its line is there."""
    file = out / f"{seed}.json"
    if file.exists():
        return
    options = RigOptions(seed=seed, overrides=as_overrides(drawn(seed)))
    description = options.description()
    try:
        with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
            rests = survey_rests(rig, description, lambda *_: None)
        line = {
            "from_rad": rests.from_rad.tolist(),
            "q_rad": rests.q_rad.tolist(),
            "markers_mm": rests.markers_mm.round(4).tolist(),
            "count": rests.count.tolist(),
            "time_s": rests.time_s.tolist(),
        }
    except CcrError as error:
        line = {"refused": str(error)}
    file.write_text(json.dumps(line) + "\n")


def judged(out: Path, seed: int) -> tuple[Array, Array] | str:
    """Errors and stated deviations, deg, (5,) each; or why the robot was refused."""
    line = json.loads((out / f"{seed}.json").read_text())
    if "refused" in line:
        return str(line["refused"])
    keys = drawn(seed)
    description = RigOptions(
        overrides=(*as_overrides(keys), "control.solver=compiled")
    ).description()
    try:
        found = fit_survey(
            Rests(**{key: np.array(value) for key, value in line.items()}), description
        )
    except CcrError as error:
        return str(error)
    if not np.array_equal(found.direction, np.sign(keys["twin.servo_us_per_90_deg"])):
        raise AssertionError(f"robot {seed}: directions found {found.direction}")
    truth = Rotation.from_rotvec(keys["tracker.rotation_deg"], degrees=True)
    off = Rotation.from_matrix(found.camera_to_robot) * truth.inv()
    zeros_off_deg = np.degrees(found.neutral_rad) - true_zeros_deg(keys)
    return (
        np.concatenate([off.as_rotvec(degrees=True), zeros_off_deg]),
        np.concatenate([found.uncertainty_deg, np.degrees(found.neutral_deviation_rad)]),
    )


def main() -> None:
    """Command line of the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="seed of the first robot")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("survey"), help="folder of the rests")
    words = parser.parse_args()
    words.out.mkdir(parents=True, exist_ok=True)
    seeds = range(words.first, words.first + words.robots)
    with ProcessPoolExecutor(words.workers) as pool:
        tours = pool.map(partial(measured, words.out), seeds)
        for _ in progress(tours, total=len(seeds), console=Console(stderr=True)):
            pass
    screen, pairs = Console(), []
    for seed in seeds:
        match judged(words.out, seed):
            case str(reason):
                screen.print(f"{seed}: refused: {reason}", soft_wrap=True)
            case errors, stated:
                pairs.append((errors, stated))
                pieces = (f"{e:+.2f} +- {d:.2f}" for e, d in zip(errors, stated, strict=True))
                screen.print(f"{seed}: {', '.join(pieces)}", soft_wrap=True)
    errors, stated = (np.array(part) for part in zip(*pairs, strict=True))
    table = Table(title=f"{len(pairs)} of {len(seeds)} robots, deg", title_justify="left")
    for heading in ("", "error RMS", "maximum", "stated, median", "within two deviations"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, error, deviation in zip(NAMES, errors.T, stated.T, strict=True):
        within = np.mean(np.abs(error) <= 2.0 * deviation)
        table.add_row(
            name,
            f"{np.sqrt(np.mean(error**2)):.2f}",
            f"{np.abs(error).max():.2f}",
            f"{np.median(deviation):.2f}",
            f"{100 * within:.1f} %",
        )
    screen.print(table)


if __name__ == "__main__":
    main()
