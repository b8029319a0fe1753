"""Hysteresis and repeatability of made-up robots whose hysteresis is known."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.tools.measured import Measured, home_of, sweeps_of

STAIRS = np.concatenate([np.linspace(0, 4, 17), np.linspace(4, 0, 17)[1:]])


def measured(command: np.ndarray, tip: np.ndarray, names: list[str] | None = None) -> Measured:
    rows = len(command)
    return Measured(
        np.arange(rows, dtype=float),
        command,
        "mm",
        tip,
        np.empty((rows, 0, 3)),
        np.array(names or [""] * rows),
    )


def behind(command: np.ndarray, width: float) -> np.ndarray:
    """What follows a command with lost motion of this width."""
    there, followed = command[0], []
    for value in command:
        there = np.clip(there, value - width / 2, value + width / 2)
        followed.append(there)
    return np.array(followed)


@pytest.mark.parametrize("width", [0.0, 0.1, 0.4])
def test_the_width_is_what_the_motor_must_travel_for_the_gap(width):
    command = np.stack([-0.5 * STAIRS, STAIRS], axis=-1)
    tip = 10.0 * behind(STAIRS, width)[:, None] * np.array([0.6, 0.0, -0.8])
    (sweep,) = sweeps_of(measured(command, tip))
    assert sweep.motor == 2
    assert sweep.command == pytest.approx(width, abs=1e-6)
    assert sweep.tip_mm == pytest.approx(10.0 * width, abs=1e-6)


def test_ways_back_along_other_commands_or_in_another_pattern_are_not_compared():
    half = len(STAIRS) // 2
    command = np.stack([STAIRS, np.zeros_like(STAIRS)], axis=-1)
    command[half + 1 :, 1] = STAIRS[half + 1 :]
    tip = np.stack([STAIRS] * 3, axis=-1)
    assert sweeps_of(measured(command, tip)) == []
    command[:, 1] = 0.0
    names = ["there"] * half + ["back"] * (len(STAIRS) - half)
    assert sweeps_of(measured(command, tip, names)) == []


def test_each_visit_to_home_counts_once_however_long_it_was():
    command = np.array([0.0, 0.0, 0.0, 5.0, 0.01, 5.0, 0.0, 0.0])[:, None]
    tip = np.zeros((8, 3))
    tip[:, 0] = [1.0, 1.0, 1.0, 50.0, -2.0, 50.0, 1.0, 1.0]
    home = home_of(measured(command, tip))
    assert home is not None
    assert home.visits == 3
    assert home.rms_mm == pytest.approx(np.sqrt(2.0))
    assert home.max_mm == pytest.approx(2.0)
    assert home_of(measured(command + 3.0, tip)) is None
