"""Draws a twin with all of its effects, its camera, a wrong model of it, and a disturbance.

Ranges are those of the project's robustness goal; factors apply to the values of the description.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description, Robot

SLACK_MM = 2.0
UNEQUAL_SLACK_MM = 0.5
"""Largest difference between tendons that a motor winds to either side, all within `SLACK_MM`."""
ZERO_DEG = 5.0
"""Zero error of each servo: a tooth of its spline is 14.4 deg; by eye the horn is set to a few
degrees."""
SPREAD = 0.5
"""Relative spread of stiffness and masses."""
BELIEF_SPREAD = 0.1
"""Relative spread of the geometry in the controller's model."""
DEAD_ZONE_DEG = 1.0
"""Largest deadband of the servos, and largest dead zone caused by friction."""
FRICTION_N = 0.5
"""Most friction of a tendon, whatever zone it makes: the hysteresis of OpenCR's robots stands for
0.15 to 0.5 N (docs/twin.md), while a degree of stiff wires would stand for several times that."""
ROTATION_DEG = 5.0
LATENCY_MS = 100.0
NOISE_MM = 0.5
DROPOUT = 0.1
PAYLOAD_G = 5.0
PUSH_N = 0.05
PUSH_S = 5.0
DAMPING = (0.5, 2.0)
"""Factors of the damping: 0.05 to 0.2 of critical on `default`."""
CAPSTAN = 0.25
"""Coefficient of friction in the holes; 0.23 to 0.26 was measured on a two-disk robot."""
CREEP = (0.06, 0.05)
CREEP_S = ((2.0, 20.0), (20.0, 200.0))
TAPER = 0.15
STIFFENING = 0.2
PLANE_DEG = 2.0
LEAF = (5.0, 12.0)
"""Width over thickness of the flexures, the square of which is sideways over bending stiffness."""
TORSION = (2.5, 8.0)
"""Torsional over bending stiffness: flexures as long as wide, to 0.4 times that (docs/twin.md)."""
AXIAL_MM_N = 1 / 16
"""Greatest shortening of a segment per force: 16 kN/m."""
MARKER_MM = 1.0
STALL_NM = (0.6, 1.1)
"""Stall torques from clones of the MG996R to the data sheet of a stronger servo."""
DROOP_DEG_NM = 13.0
BACKLASH_DEG = 1.0
LAG_MS = 40.0
DRIFT_DEG = 1.0
DRIFT_S = (60.0, 1800.0)
OUTLIERS = 0.01
OUTLIER_MM = (1.0, 10.0)
JITTER_MS = 3.0
EXPOSURE_MS = 10.0

_GEOMETRY = (
    "segment_lengths_mm",
    "tendon_radius_mm",
    "marker_offset_mm",
    "pulley_radius_mm",
)
"""Kept as described in the twin, while the controller's model of it is drawn."""

Settings = dict[str, Any]
"""Values of the robot description by their dotted keys."""


def draw_twin(
    rng: np.random.Generator, base: Description, duration_s: float, *, faults: bool = True
) -> Settings:
    """Draw one twin; the same generator state gives the same twin.

    The generator is called the same number of times for the same ``faults``: effects that no
    controller models, which come last and leave the rest as it is. A push falls within
    ``duration_s``.
    """
    twin, robot = base.twin, base.robot
    stiffness = [_spread(rng, k, SPREAD) for k in twin.bending_stiffness_nm_rad]
    slack_mm = rng.uniform(0.0, SLACK_MM)
    disk_mass_g = _spread(rng, twin.disk_mass_g, SPREAD)
    marker_mass_g = _spread(rng, twin.marker_mass_g, SPREAD)
    payload_g = rng.uniform(0.0, PAYLOAD_G)
    dead_zones_deg = rng.uniform(0.0, DEAD_ZONE_DEG, 2)
    most_friction_n = min(FRICTION_N, friction_n(base, DEAD_ZONE_DEG))
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
        "twin.friction": most_friction_n * dead_zones_deg[1] / DEAD_ZONE_DEG,
        "twin.push": {
            "force_n": force_n.tolist(),
            "start_s": push_start_s,
            "end_s": push_start_s + push_s,
        },
        "tracker.rotation_deg": (rng.uniform(0.0, ROTATION_DEG) * _direction(rng)).tolist(),
        "tracker.latency_ms": rng.uniform(0.0, LATENCY_MS),
        "tracker.noise_mm": rng.uniform(0.0, NOISE_MM),
        "tracker.dropout": DROPOUT,
        **_believed(rng, robot),
        "robot.marker_offset_mm": _spread(rng, robot.marker_offset_mm, BELIEF_SPREAD),
        "robot.pulley_radius_mm": _spread(rng, robot.pulley_radius_mm, BELIEF_SPREAD),
    }
    more_mm = 0.5 * rng.uniform(-UNEQUAL_SLACK_MM, UNEQUAL_SLACK_MM, robot.motors)
    zeros = rng.uniform(-ZERO_DEG, ZERO_DEG, robot.motors) / 90.0
    servo = base.servo
    slacks_mm = [slack_mm + t.winding * more_mm[t.motor - 1] for _, t in robot.tendons]
    settings |= {
        "twin.slack_mm": np.clip(slacks_mm, 0.0, SLACK_MM).tolist(),
        "twin.servo_neutral_us": (
            np.array(servo.neutral_pulse_us) + zeros * servo.pulse_per_90_deg_us
        ).tolist(),
        **(_faults(rng, base) if faults else {}),
    }
    return {key: _readable(value) for key, value in settings.items()}


def _believed(rng: np.random.Generator, robot: Robot) -> Settings:
    """Draw the controller's model of lengths and radii."""
    lengths_mm = [_spread(rng, length, BELIEF_SPREAD) for length in robot.segment_lengths_mm]
    if not robot.segments:
        radius_mm = _spread(rng, robot.tendon_radius_mm, BELIEF_SPREAD)
        return {"robot.segment_lengths_mm": lengths_mm, "robot.tendon_radius_mm": radius_mm}
    segments = [
        segment.model_dump(exclude_unset=True)
        | {
            "length_mm": length_mm,
            "tendon_radius_mm": _spread(rng, segment.tendon_radius_mm, BELIEF_SPREAD),
        }
        for segment, length_mm in zip(robot.segments, lengths_mm, strict=True)
    ]
    return {"robot.segments": segments}


def _faults(rng: np.random.Generator, base: Description) -> Settings:
    """Draw what `ideal` lacks and no controller models."""
    twin, parts = base.twin, len(base.robot.chain)
    stiffness = np.array(twin.bending_stiffness_nm_rad)
    return {
        "twin.joint_damping": twin.joint_damping * rng.uniform(*DAMPING),
        "twin.capstan_friction": rng.uniform(0.0, CAPSTAN),
        "twin.creep_share": rng.uniform(0.0, CREEP).tolist(),
        "twin.creep_time_s": [rng.uniform(*span) for span in CREEP_S],
        "twin.stiffness_taper": rng.uniform(-TAPER, TAPER, parts).tolist(),
        "twin.stiffening": rng.uniform(0.0, STIFFENING, parts).tolist(),
        "twin.bending_plane_turn_deg": rng.uniform(-PLANE_DEG, PLANE_DEG, parts).tolist(),
        "twin.sideways_stiffness_nm_rad": (stiffness * rng.uniform(*LEAF, parts) ** 2).tolist(),
        "twin.torsion_stiffness_nm_rad": (stiffness * rng.uniform(*TORSION, parts)).tolist(),
        "twin.axial_stiffness_n_m": (1e3 / rng.uniform(1e-3, AXIAL_MM_N, parts)).tolist(),
        "twin.servo_stall_torque_nm": rng.uniform(*STALL_NM),
        "twin.servo_droop_deg_per_nm": rng.uniform(0.0, DROOP_DEG_NM),
        "twin.servo_backlash_deg": rng.uniform(0.0, BACKLASH_DEG),
        "twin.servo_lag_ms": rng.uniform(0.0, LAG_MS),
        "twin.servo_drift_deg": rng.uniform(-DRIFT_DEG, DRIFT_DEG, base.robot.motors).tolist(),
        "twin.servo_drift_time_s": rng.uniform(*DRIFT_S),
        "tracker.outliers": rng.uniform(0.0, OUTLIERS),
        "tracker.outlier_mm": rng.uniform(*OUTLIER_MM),
        "tracker.frame_jitter_ms": rng.uniform(0.0, JITTER_MS),
        "tracker.exposure_ms": rng.uniform(0.0, EXPOSURE_MS),
        "twin.marker_offset_mm": (
            np.array(twin.marker_offset_mm) + rng.uniform(-MARKER_MM, MARKER_MM, 3)
        ).tolist(),
    }


def friction_n(base: Description, dead_zone_deg: float) -> float:
    """Tendon friction that keeps the robot still while a motor turns by the dead zone to one side.

    A stuck robot moves once the force of one tendon has changed by the friction of all m tendons of
    its motor, two of a pair: k_t r_p phi = m F. A reversal takes twice the zone, as with a servo's
    deadband.
    """
    pull_n_rad = base.twin.tendon_stiffness_n_m * base.twin.pulley_radius_mm * 1e-3
    return pull_n_rad * math.radians(dead_zone_deg) * base.robot.motors / len(base.robot.tendons)


def as_overrides(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Arguments for ``--set``, one for each key."""
    return tuple(f"{key}={_toml(value)}" for key, value in settings.items())


def _spread(rng: np.random.Generator, value: float, share: float) -> float:
    return value * rng.uniform(1.0 - share, 1.0 + share)


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _readable(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    """Round to four digits, so that the command line is readable and repeats the twin exactly."""
    if isinstance(value, dict):
        return {key: _readable(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(part) for part in value]
    if isinstance(value, str | int):
        return value
    return float(f"{value:.4g}")


def _toml(value: Any) -> str:  # noqa: ANN401 - any TOML value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else str(value)
