"""Keeps a calibration where it belongs: in the robot description and in the board's EEPROM."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ccr_host.config import Description, Servo
from ccr_host.description_file import file_to_keep_in, keep_in
from ccr_host.errors import ConfigError
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client

_KEYS = ("neutral_pulse_us", "pulse_per_90_deg_us", "angle_min_deg", "angle_max_deg")


def file_for_calibration(robot: str | None, out: Path | None) -> Path:
    """Where a calibration goes, to be asked before any work is done.

    Args:
        robot: as given with ``--robot``.
        out: as given with ``--out``.

    Raises:
        ConfigError: no file of the user's was given, or it could not be written.
    """
    file = file_to_keep_in(robot, out)
    if file is None:
        raise ConfigError(
            "a calibration belongs to one robot, and no file of yours was given",
            "give --out FILE, or your own description with --robot FILE",
        )
    return file


def calibrated_section(servo: Servo) -> dict[str, Any]:
    """The keys of ``[servo]`` that a calibration decides."""
    return {key: list(getattr(servo, key)) for key in _KEYS}


def keep_calibration(
    client: Client, description: Description, servo: Servo, file: Path, robot: str | None
) -> None:
    """Set the board, let it save, then rewrite the description.

    Args:
        client: of the board.
        description: as it was; only its servos are replaced.
        servo: as calibrated.
        file: of `file_for_calibration`.
        robot: as given with ``--robot``.

    Raises:
        ConfigError: the board cannot take it, or the file cannot be written.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    client.configure(board_config(description.model_copy(update={"servo": servo})))
    client.save_config()
    keep_in(file, {"servo": calibrated_section(servo)}, robot)
