"""Rests that an identification run has kept in the robot description."""

from __future__ import annotations

import hashlib
import json

import numpy as np

from ccr_host.control.adaptive.identification import Rests
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description

_PULSE_KEYS = {"neutral_pulse_us", "pulse_per_90_deg_us"}
"""What a commanded angle means; limits may change."""
_DIGITS = 12


def digest_of(description: Description) -> str:
    """Of all in a description that decides what its identified rests mean."""
    registration = description.registration
    meaning = {
        "robot": description.robot.model_dump(),
        "servo": description.servo.model_dump(include=_PULSE_KEYS),
        "camera": None if registration is None else registration.camera_to_robot_deg,
    }
    text = json.dumps(meaning, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def identified_rests(description: Description) -> Rests | None:
    """The rests of a description; None if nobody has identified the robot.

    Raises:
        ConfigError: they were measured with another geometry, servo pulses or registration.
    """
    identified = description.identified
    if identified is None:
        return None
    if identified.valid_for != digest_of(description):
        raise ConfigError(
            "section identified was measured with another [robot], other servo pulses or another "
            "[registration]",
            "identify again: ccr-host calibrate --identify; or remove the section",
        )
    not_seen = np.full_like(identified.tip_mm, np.nan)
    middle_mm = np.array(identified.middle_mm) if identified.middle_mm else not_seen
    return Rests(
        start_rad=np.array(identified.start_rad),
        setpoint_rad=np.array(identified.setpoint_rad),
        markers_mm=np.stack([middle_mm, identified.tip_mm], axis=1),
        count=np.array(identified.count, dtype=np.float64),
    )
