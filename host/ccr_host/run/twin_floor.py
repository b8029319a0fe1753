"""The least mean error on a path that the statics of the twin allow."""

from __future__ import annotations

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
from ccr_host.sim.robot.plant import TWIN
from ccr_host.sim.robot.static_map import StaticMap, default_cache, load_static_map


def twin_floor_mm(result: RunResult) -> float | None:
    """Floor of a run's path on its twin, whose static map is kept in the user's cache.

    It applies to the undisturbed robot: a payload added during the run, a push, friction and
    deadband are not considered.

    Returns:
        mm; None if the robot was real or not the twin, or if the twin has no rest pose for some
        motor angles.
    """
    if all(record.true_mm is None for record in result.records):
        return None
    static_map = static_map_of_run(result.options, default_cache())
    if static_map is None:
        return None
    return floor_on_map_mm(static_map, result.options.description(), result.reference)


def keep_static_map(options: RunOptions) -> None:
    """Store the static map of a run's twin in the user's cache, if it is missing."""
    static_map_of_run(options, default_cache())


def static_map_of_run(options: RunOptions, cache: Path | None) -> StaticMap | None:
    """The static map of a run's twin.

    None for other plants, if some rest pose is missing, and so far for robots of segments.
    """
    description = options.description()
    with suppress(CcrError):
        if options.plant == TWIN and not description.robot.segments:
            return static_map_of(description, cache)
    return None


def static_map_of(description: Description, cache: Path | None) -> StaticMap:
    """The rest poses of the twin within the motor limits.

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
    rate_deg_s = np.minimum(description.servo.slew_deg_s, description.twin.servo_rate_deg_s)
    floor = floor_of(static_map, reference.target_mm, reference.period_s, np.radians(rate_deg_s))
    return floor.within_rate_mm


def _shaft_limits_deg(
    description: Description,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles of the twin's shafts at the limits of the commanded angles, (2,) each."""
    servo, twin = description.servo, description.twin
    limits_deg = np.array([servo.angle_min_deg, servo.angle_max_deg])
    pulses_us = np.clip(
        np.array(servo.neutral_pulse_us) + limits_deg / 90.0 * np.array(servo.pulse_per_90_deg_us),
        servo.pulse_min_us,
        servo.pulse_max_us,
    )
    shafts_deg = (pulses_us - twin.servo_neutral_us) * 90.0 / np.array(twin.servo_us_per_90_deg)
    return shafts_deg.min(axis=0), shafts_deg.max(axis=0)
