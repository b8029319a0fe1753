"""A simulated robot of your own: constant curvature, without mass, friction or delay.

ccr-host track 8shape --plant examples/own_plant.py:ConstantCurvaturePlant
"""

import numpy as np
from numpy.typing import NDArray

import ccr_host
from ccr_host.robot.kinematics import ConstantCurvature


class ConstantCurvaturePlant(ccr_host.Plant):
    """Takes the pose that its pulses ask for at once."""

    def __init__(self, description: ccr_host.Description) -> None:
        robot, self._servo = description.robot, description.servo
        only_first = {"segment_lengths_mm": (robot.segment_lengths_mm[0], 0.0)}
        self._middle = ConstantCurvature(robot.model_copy(update=only_first))
        self._tip = ConstantCurvature(robot)
        self._q_rad = np.zeros(2)

    def set_pulses_half_us(self, pulses_half_us: tuple[int, int]) -> None:
        if all(pulses_half_us):
            turn = np.array(pulses_half_us) / 2 - self._servo.neutral_pulse_us
            self._q_rad = np.radians(90 * turn / self._servo.pulse_per_90_deg_us)

    def advance_to(self, time_us: int) -> None:
        """It has nothing to do with time."""

    def markers_mm(self) -> NDArray[np.float64]:
        q_rad = self._q_rad
        return np.array([np.zeros(3), self._middle.tip_mm(q_rad), self._tip.tip_mm(q_rad)])


if __name__ == "__main__":
    with ccr_host.open_robot(plant=ConstantCurvaturePlant) as robot:
        summary = robot.track("8shape", "mpc").summary
    print(f"mean true error {summary['true_mean_error_mm']:.2f} mm: the model is exact here")
