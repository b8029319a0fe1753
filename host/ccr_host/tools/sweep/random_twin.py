"""Draws a twin, its camera, the controller's wrong model of it, and a disturbance.

Ranges are those of the project's robustness goal; factors apply to the values of the description.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccr_host.description.schema import Description

SLACK_MM = 2.0
UNEQUAL_SLACK_MM = 0.5
"""Largest difference between the two tendons of a motor, with both within `SLACK_MM`."""
ZERO_DEG = 5.0
"""Zero error of each servo: a tooth of its spline is 14.4 deg; by eye the horn is set to a few
degrees."""
SPREAD = 0.5
"""Relative spread of stiffness and masses."""
BELIEF_SPREAD = 0.1
"""Relative spread of the geometry in the controller's model."""
DEAD_ZONE_DEG = 1.0
"""Largest deadband of the servos, and largest dead zone caused by friction."""
ROTATION_DEG = 5.0
LATENCY_MS = 100.0
NOISE_MM = 0.5
DROPOUT = 0.1
PAYLOAD_G = 5.0
PUSH_N = 0.05
PUSH_S = 5.0

_GEOMETRY = (
    "segment_lengths_mm",
    "tendon_radius_mm",
    "marker_offset_mm",
    "pulley_radius_mm",
)
"""Kept as described in the twin, while the controller's model of it is drawn."""

Settings = dict[str, Any]
"""Values of the robot description by their dotted keys."""


def draw_twin(rng: np.random.Generator, base: Description, duration_s: float) -> Settings:
    """Draw one twin; the same generator state gives the same twin.

    Args:
        rng: always called the same number of times.
        base: description that the factors apply to.
        duration_s: duration of the path, in which the push falls.
    """
    twin, robot = base.twin, base.robot
    stiffness = [_spread(rng, k, SPREAD) for k in twin.bending_stiffness_nm_rad]
    slack_mm = rng.uniform(0.0, SLACK_MM)
    disk_mass_g = _spread(rng, twin.disk_mass_g, SPREAD)
    marker_mass_g = _spread(rng, twin.marker_mass_g, SPREAD)
    payload_g = rng.uniform(0.0, PAYLOAD_G)
    dead_zones_deg = rng.uniform(0.0, DEAD_ZONE_DEG, 2)
    push_s = min(PUSH_S, duration_s)
    push_start_s = rng.uniform(0.0, max(duration_s - push_s, 0.0))
    force_n = rng.uniform(0.0, PUSH_N) * _direction(rng)
    settings = {
        **{f"twin.{key}": getattr(twin, key) for key in _GEOMETRY},
        "twin.bending_stiffness_nm_rad": stiffness,
        "twin.disk_mass_g": disk_mass_g,
        "twin.marker_mass_g": marker_mass_g,
        "twin.payload_g": payload_g,
        "twin.servo_deadband_deg": dead_zones_deg[0],
        "twin.friction": friction_n(base, dead_zones_deg[1]),
        "twin.push": {
            "force_n": force_n.tolist(),
            "start_s": push_start_s,
            "end_s": push_start_s + push_s,
        },
        "tracker.rotation_deg": (rng.uniform(0.0, ROTATION_DEG) * _direction(rng)).tolist(),
        "tracker.latency_ms": rng.uniform(0.0, LATENCY_MS),
        "tracker.noise_mm": rng.uniform(0.0, NOISE_MM),
        "tracker.dropout": DROPOUT,
        "robot.segment_lengths_mm": [
            _spread(rng, length, BELIEF_SPREAD) for length in robot.segment_lengths_mm
        ],
        "robot.tendon_radius_mm": _spread(rng, robot.tendon_radius_mm, BELIEF_SPREAD),
        "robot.marker_offset_mm": _spread(rng, robot.marker_offset_mm, BELIEF_SPREAD),
        "robot.pulley_radius_mm": _spread(rng, robot.pulley_radius_mm, BELIEF_SPREAD),
    }
    more_mm = 0.5 * rng.uniform(-UNEQUAL_SLACK_MM, UNEQUAL_SLACK_MM, 2)
    zeros = rng.uniform(-ZERO_DEG, ZERO_DEG, 2) / 90.0
    servo = base.servo
    settings |= {
        "twin.slack_mm": np.clip(slack_mm + np.append(more_mm, -more_mm), 0.0, SLACK_MM).tolist(),
        "twin.servo_neutral_us": (
            np.array(servo.neutral_pulse_us) + zeros * servo.pulse_per_90_deg_us
        ).tolist(),
    }
    return {key: _readable(value) for key, value in settings.items()}


def friction_n(base: Description, dead_zone_deg: float) -> float:
    """Tendon friction that keeps the robot still while a motor turns by the dead zone to one side.

    A stuck robot moves once the force of one tendon has changed by the friction of both tendons of
    its pair: k_t r_p phi = 2 F. A reversal takes twice the zone, as with a servo's deadband.
    """
    pull_n_rad = base.twin.tendon_stiffness_n_m * base.twin.pulley_radius_mm * 1e-3
    return pull_n_rad * math.radians(dead_zone_deg) / 2


def as_overrides(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Arguments for ``--set``, one for each key."""
    return tuple(f"{key}={_toml(value)}" for key, value in settings.items())


def _spread(rng: np.random.Generator, value: float, share: float) -> float:
    return value * rng.uniform(1.0 - share, 1.0 + share)


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _readable(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    """Round to four digits, so that the command line is readable and repeats the twin exactly."""
    if isinstance(value, dict):
        return {key: _readable(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(part) for part in value]
    return float(f"{value:.4g}")


def _toml(value: Any) -> str:  # noqa: ANN401 - any TOML value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return str(value)
