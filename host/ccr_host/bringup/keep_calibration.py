"""Keeps a calibration where it belongs: in the robot description and in the board's EEPROM."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ccr_host.config import Description, Servo, shipped_descriptions
from ccr_host.description_file import update_description
from ccr_host.errors import ConfigError
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client

_KEYS = ("neutral_pulse_us", "pulse_per_90_deg_us", "angle_min_deg", "angle_max_deg")


def writable_description(robot: str | None) -> Path:
    """The user's own description, to be asked for before any work is done.

    Raises:
        ConfigError: none was given, or it is not the user's own.
    """
    if robot is None or robot in shipped_descriptions():
        raise ConfigError(
            "a calibration belongs to one robot, and no file of yours was given",
            'write its description, e.g. name = "my robot", to a file; then --robot FILE',
        )
    return Path(robot)


def calibrated_section(servo: Servo) -> dict[str, Any]:
    """The keys of ``[servo]`` that a calibration decides."""
    return {key: list(getattr(servo, key)) for key in _KEYS}


def keep_calibration(client: Client, description: Description, servo: Servo, file: Path) -> None:
    """Set the board, let it save, then rewrite the description.

    Raises:
        ConfigError: the board cannot take it, or the file cannot be written.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    client.configure(board_config(description.model_copy(update={"servo": servo})))
    client.save_config()
    update_description(file, {"servo": calibrated_section(servo)})
