"""The least mean error on a path that the statics of the twin allow.

Of a robot with two motors it is found on a map of its rest poses, of any other by descent from
target to target: a minimum that can be followed, not always the least one.
"""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.reference import Reference
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult
from ccr_host.sim.robot.floor import floor_of
from ccr_host.sim.robot.nearest_rest import distances_mm
from ccr_host.sim.robot.plant import TWIN
from ccr_host.sim.robot.static_map import (
    STATIC_KEYS,
    StaticMap,
    default_cache,
    kept_arrays,
    load_static_map,
)

_MAPPED_MOTORS = 2
_MOST_TARGETS = 40


def twin_floor_mm(result: RunResult) -> float | None:
    """Floor of a run's path on its twin; what it takes to compute is kept in the user's cache.

    It applies to the undisturbed robot: a payload added during the run, a push, friction and
    deadband are not considered.

    Returns:
        mm; None if the robot was real or not the twin, or if the twin has no rest pose for some
        motor angles.
    """
    if all(record.true_mm is None for record in result.records):
        return None
    options = result.options
    static_map = static_map_of_run(options, default_cache())
    if static_map is not None:
        return floor_on_map_mm(static_map, options.description(), result.reference)
    with suppress(CcrError):
        if options.plant == TWIN and options.description().robot.motors != _MAPPED_MOTORS:
            return floor_by_descent_mm(options.description(), result.reference, default_cache())
    return None


def keep_static_map(options: RunOptions) -> None:
    """Store the static map of a run's twin in the user's cache, if it is missing."""
    static_map_of_run(options, default_cache())


def static_map_of_run(options: RunOptions, cache: Path | None) -> StaticMap | None:
    """The static map of a run's twin of two motors.

    None for other plants and numbers of motors, or if some rest pose is missing.
    """
    with suppress(CcrError):
        if options.plant == TWIN and options.description().robot.motors == _MAPPED_MOTORS:
            return static_map_of(options.description(), cache)
    return None


def static_map_of(description: Description, cache: Path | None) -> StaticMap:
    """The rest poses of a twin of two motors within their limits.

    Args:
        description: of the robot.
        cache: folder of the stored maps; None computes without storing.

    Raises:
        CcrError: some motor angles leave the twin without a rest pose.
    """
    lower_deg, upper_deg = _shaft_limits_deg(description)
    return load_static_map(description.twin, lower_deg, upper_deg, cache)


def floor_on_map_mm(static_map: StaticMap, description: Description, reference: Reference) -> float:
    """Least mean distance of any motor path within the rates of board and servo, mm."""
    rate_rad_s = np.radians(_rate_deg_s(description))
    floor = floor_of(static_map, reference.target_mm, reference.period_s, rate_rad_s)
    return floor.within_rate_mm


def floor_by_descent_mm(
    description: Description, reference: Reference, cache: Path | None
) -> float:
    """Mean distance of the path from rest poses within the rates of board and servo, mm.

    Of one lap, and of up to `_MOST_TARGETS` evenly spaced targets: one takes up to 0.7 s.

    Raises:
        CcrError: the twin has no rest pose on the way to the path.
    """
    twin, (lower_deg, upper_deg) = description.twin, _shaft_limits_deg(description)
    every = math.ceil(reference.lap_steps / _MOST_TARGETS)
    targets_mm = reference.target_mm[: reference.lap_steps : every]
    reach_deg = every * reference.period_s * _rate_deg_s(description)
    key = (
        twin.model_dump_json(include=set(STATIC_KEYS)),
        *(array.tolist() for array in (lower_deg, upper_deg, targets_mm, reach_deg)),
    )
    found = kept_arrays(
        cache,
        "floor",
        key,
        lambda: {"mm": distances_mm(twin, lower_deg, upper_deg, targets_mm, reach_deg)},
    )
    return float(found["mm"].mean())


def _rate_deg_s(description: Description) -> NDArray[np.float64]:
    return np.minimum(description.servo.slew_deg_s, description.twin.servo_rate_deg_s)


def _shaft_limits_deg(
    description: Description,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles of the twin's shafts at the limits of the commanded angles, (n,) each."""
    servo, twin = description.servo, description.twin
    limits_deg = np.array([servo.angle_min_deg, servo.angle_max_deg])
    pulses_us = np.clip(
        np.array(servo.neutral_pulse_us) + limits_deg / 90.0 * np.array(servo.pulse_per_90_deg_us),
        servo.pulse_min_us,
        servo.pulse_max_us,
    )
    shafts_deg = (pulses_us - twin.servo_neutral_us) * 90.0 / np.array(twin.servo_us_per_90_deg)
    return shafts_deg.min(axis=0), shafts_deg.max(axis=0)
