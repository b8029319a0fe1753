"""Static poses of the twin, to compare descriptions with each other and with (10)."""

from __future__ import annotations

import pytest

from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.robot import TwinRobot

WELL_DAMPED = {"joint_damping": 4e-3}
"""Twenty times the default: at rest within two seconds, at the same place."""


@pytest.fixture
def pulses_half_us():
    def pulses(first_deg: float, second_deg: float) -> tuple[int, int]:
        return round(3000 + first_deg * 2000 / 90), round(3000 + second_deg * 2000 / 90)

    return pulses


@pytest.fixture
def posed(pulses_half_us):
    """Build a robot at rest with its servos at the given angles."""

    def build(first_deg: float = 0.0, second_deg: float = 0.0, **keys) -> TwinRobot:
        robot = TwinRobot(Twin(**(WELL_DAMPED | keys)))
        if first_deg or second_deg:
            robot.set_pulses_half_us(pulses_half_us(first_deg, second_deg))
            robot.advance_to(2_000_000)
        return robot

    return build


@pytest.fixture
def tip(posed):
    """Tip at rest, mm."""
    return lambda *angles_deg, **keys: posed(*angles_deg, **keys).tip_mm()
