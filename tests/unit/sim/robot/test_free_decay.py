"""The twin rings about as long as real tendon-driven robots do.

Ratios of critical damping from free vibrations: 0.14 to 0.23 for a catheter segment with an
antagonistic pair of tendons, 0.21 to 0.34 for the trunk in `TRUNK`.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import find_peaks

from ccr_host.description.simulation import Push, Twin
from ccr_host.sim.robot.robot import TwinRobot
from tests.measured import measured

TRUNK = measured("trunk_free_decay_200g.csv")


def damping_ratios(positions_mm: NDArray[np.float64], least_swing_mm: float) -> list[float]:
    """Ratio of critical damping from each pair of successive half swings, along the main direction.

    A half swing is smaller than the one before by the factor exp(-pi zeta / sqrt(1 - zeta^2)).
    """
    about_mean = positions_mm - positions_mm.mean(axis=0)
    along_mm = about_mean @ np.linalg.svd(about_mean, full_matrices=False)[2][0]
    extremes = np.concatenate(
        [find_peaks(sign * along_mm, prominence=least_swing_mm)[0] for sign in (1, -1)]
    )
    swings_mm = np.abs(np.diff(along_mm[np.sort(extremes)]))
    decrements = np.log(swings_mm[:-1] / swings_mm[1:])
    ratios: list[float] = (decrements / np.hypot(np.pi, decrements)).tolist()
    return ratios


def released(twin: Twin, pulses_half_us: tuple[int, int]) -> NDArray[np.float64]:
    """Tip after a push of 0.05 N upwards ends, every 5 ms for 1.5 s."""
    push = Push(force_n=(0.0, 0.0, 0.05), start_s=0.0, end_s=2.0)
    robot = TwinRobot(twin.model_copy(update={"push": push}))
    robot.start_path_clock(0)
    robot.set_pulses_half_us(pulses_half_us)
    tips_mm = []
    for time_us in range(2_000_000, 3_500_000, 5_000):
        robot.advance_to(time_us)
        tips_mm.append(robot.tip_mm())
    return np.array(tips_mm)


@pytest.mark.parametrize("angles_deg", [(0, 0), (18, 0), (18, 27)])
def test_a_released_robot_rings_with_a_tenth_to_a_fifth_of_critical_damping(
    pulses_half_us, angles_deg
):
    # An even number of half swings: slack makes those to one side die away more slowly.
    ratios = damping_ratios(released(Twin(joint_damping=1.2e-3), pulses_half_us(*angles_deg)), 0.3)
    assert len(ratios) >= 4
    assert 0.1 < np.mean(ratios[:4]) < 0.2


if TRUNK is not None:

    def test_the_same_function_finds_the_trunk_damped_as_published() -> None:
        rows = np.genfromtxt(TRUNK, delimiter=",", names=True)
        for trajectory in np.unique(rows["trajectory"]):
            trial = rows[rows["trajectory"] == trajectory]
            tip_mm = np.stack([trial[f"{axis}3_mm"] for axis in "xyz"], axis=1)
            large = damping_ratios(tip_mm, 2.0)[:3]
            assert 0.21 < np.mean(large) < 0.34
