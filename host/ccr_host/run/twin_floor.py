"""The least mean error on a path that the statics of the twin allow."""

from __future__ import annotations

import hashlib
import math
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.core.user_file import cache_folder, replacing
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult
from ccr_host.sim.robot.equilibrium import nearest_rests
from ccr_host.sim.robot.plant import TWIN

_MOST_SEARCHED = 160
"""Targets times motors: a target takes 6 ms of CPU with two motors, 1.3 s with nine."""
_MOST_KEPT = 500
"""Files of about 3 kB."""
_VERSION = 1
"""Part of what files are found by; increment it when the rests of the same twin change."""
_UNREADABLE = (OSError, ValueError, EOFError, RuntimeError, KeyError, zipfile.BadZipFile)


def floor_of_run_mm(result: RunResult) -> float | None:
    """``twin_floor_mm`` of a run, kept in the user's cache; None if the robot was real."""
    if all(record.true_mm is None for record in result.records):
        return None
    return twin_floor_mm(result.options, result.reference, cache_folder())


def twin_floor_mm(
    options: RunOptions, reference: Reference, cache: Path | None = None
) -> float | None:
    """Mean distance of the path from the nearest rest poses of the twin.

    Of one lap, and of evenly spaced targets where there are many. It applies to the undisturbed
    robot: a payload added during the run, a push, friction, deadband and the rates of the servos
    are not considered. ``cache`` is a folder for what was found; None does not keep it.

    Returns:
        mm; None if the plant is not the twin, or if the twin has no rest pose somewhere.
    """
    if options.plant != TWIN:
        return None
    description = options.description()
    every = math.ceil(reference.lap_steps * description.robot.motors / _MOST_SEARCHED)
    try:
        _, distances_mm = rests_along(description, reference, every, cache)
    except CcrError:
        return None
    return float(distances_mm.mean())


def rests_along(
    description: Description, reference: Reference, every: int = 1, cache: Path | None = None
) -> tuple[Array, Array]:
    """The twin's rest poses nearest to a lap's targets.

    Each is sought from the one before and from the model's: a minimum, not always the least one
    (docs/sweep.md). ``every`` is the number of steps between targets; ``cache`` is as in
    `twin_floor_mm`.

    Returns:
        Angles of the shafts in rad, (M, n), and distances in mm, (M,).

    Raises:
        CcrError: the twin has no rest pose on the way.
    """
    servo, chosen = description.servo, slice(0, reference.lap_steps, every)
    limits_deg = np.array([servo.angle_min_deg, servo.angle_max_deg])
    at_limits_rad = np.radians(_shafts_deg(description, limits_deg))
    guesses_rad = np.radians(_shafts_deg(description, np.degrees(reference.q_rad[chosen])))
    way = (
        at_limits_rad.min(axis=0), at_limits_rad.max(axis=0),
        reference.target_mm[chosen], guesses_rad,
    )  # fmt: skip
    if cache is None:
        return nearest_rests(description.twin, *way)
    of_what = (_VERSION, description.twin.model_dump_json(), *(part.tolist() for part in way))
    file = cache / f"rests-{hashlib.sha256(repr(of_what).encode()).hexdigest()[:16]}.npz"
    with suppress(*_UNREADABLE), np.load(file) as kept:
        return kept["motors_rad"], kept["distances_mm"]
    found = nearest_rests(description.twin, *way)
    _keep(file, *found)
    return found


def _keep(file: Path, motors_rad: Array, distances_mm: Array) -> None:
    """Write a file of the cache; where that is impossible, results are computed again."""
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as draft, draft.open("wb") as opened:
            np.savez(opened, motors_rad=motors_rad, distances_mm=distances_mm)
        kept = sorted(file.parent.glob("rests-*.npz"), key=lambda one: one.stat().st_mtime)
        for oldest in kept[:-_MOST_KEPT]:
            oldest.unlink()


def _shafts_deg(description: Description, commanded_deg: Array) -> Array:
    """Angles of the twin's shafts at commanded ones, as far as pulses go; (..., n) each."""
    servo, twin = description.servo, description.twin
    pulses_us = np.clip(
        np.array(servo.neutral_pulse_us)
        + commanded_deg / 90.0 * np.array(servo.pulse_per_90_deg_us),
        servo.pulse_min_us,
        servo.pulse_max_us,
    )
    shafts_deg: Array = (
        (pulses_us - twin.servo_neutral_us) * 90.0 / np.array(twin.servo_us_per_90_deg)
    )
    return shafts_deg
