"""Checks the deviations stated by ``ccr-host setup``: ``python -m bench.survey --robots 100``.

Random robots: servos off by up to 10 deg, reversed or not, any rotation of the camera, slack of
each segment up to 2 mm, friction of each tendon up to 0.3 N. One tour each in virtual time.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table
from scipy.spatial.transform import Rotation

from ccr_host.core.errors import CcrError
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools.survey import survey
from ccr_host.tools.sweep.random_twin import as_overrides

NAMES = ("camera about x", "camera about y", "camera about z", "zero of motor 1", "zero of motor 2")
ZERO_DEG, SLACK_MM, FRICTION_N, SCALE_US = 10.0, 2.0, 0.3, 1000.0
Array = NDArray[np.float64]


def surveyed(seed: int) -> tuple[Array, Array]:
    """Errors and stated deviations, deg, (5,) each; NaN for a robot that is rejected.

    Raises:
        CcrError: the tour does not determine the robot reliably.
        AssertionError: a servo's direction is wrong.
    """
    rng = np.random.default_rng(seed)
    zeros_deg = rng.uniform(-ZERO_DEG, ZERO_DEG, 2)
    scales_us = rng.choice([-SCALE_US, SCALE_US], 2)
    axis = rng.normal(size=3)
    rotation_deg = rng.uniform(0.0, 180.0) * axis / np.linalg.norm(axis)
    slack_mm = rng.uniform(0.0, SLACK_MM, 2).tolist()
    keys = {
        "tracker.rotation_deg": rotation_deg.tolist(),
        "twin.servo_neutral_us": (1500.0 + zeros_deg * SCALE_US / 90.0).tolist(),
        "twin.servo_us_per_90_deg": scales_us.tolist(),
        "twin.slack_mm": [*slack_mm, *slack_mm],
        "twin.friction": float(rng.uniform(0.0, FRICTION_N)),
    }
    options = RigOptions(
        robot=None,
        device="emulator:",
        tracker="twin:",
        seed=seed,
        overrides=as_overrides(keys),
        realtime=False,
    )
    description = options.description()
    with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
        found = survey(rig, description, lambda *_: None)
    assert np.array_equal(found.servos.direction, np.sign(scales_us))
    truth = Rotation.from_rotvec(rotation_deg, degrees=True)
    off = Rotation.from_matrix(found.registration.camera_to_robot) * truth.inv()
    turned_deg = off.as_rotvec(degrees=True)
    off_deg = np.degrees(found.servos.neutral_rad) - zeros_deg
    stated_deg = np.degrees(found.servos.neutral_deviation_rad)
    return (
        np.concatenate([turned_deg, off_deg]),
        np.concatenate([found.registration.uncertainty_deg, stated_deg]),
    )


def main() -> None:
    """Command line of the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", type=int, default=100)
    robots = parser.parse_args().robots
    refused: Counter[str] = Counter()
    pairs = []
    for seed in progress(range(1, robots + 1), console=Console(stderr=True)):
        try:
            pairs.append(surveyed(seed))
        except CcrError as error:
            refused[f"{seed}: {error}"] += 1
    errors, stated = (np.array(part) for part in zip(*pairs, strict=True))
    table = Table(title=f"{len(pairs)} of {robots} robots, deg", title_justify="left")
    for heading in ("", "error RMS", "maximum", "stated, median", "within two deviations"):
        table.add_column(heading, justify="right" if heading else "left")
    for name, error, deviation in zip(NAMES, errors.T, stated.T, strict=True):
        within = np.mean(np.abs(error) <= 2.0 * deviation)
        table.add_row(
            name,
            f"{np.sqrt(np.mean(error**2)):.2f}",
            f"{np.abs(error).max():.2f}",
            f"{np.median(deviation):.2f}",
            f"{100 * within:.0f} %",
        )
    screen = Console()
    screen.print(table)
    for reason in refused:
        screen.print(f"rejected: {reason}")


if __name__ == "__main__":
    main()
