"""A simulated robot of your own: constant curvature of any robot, without mass, friction or delay.

ccr-host track 8shape --plant examples/own_plant.py:ConstantCurvaturePlant
"""

import numpy as np
from numpy.typing import NDArray

import ccr_host
from ccr_host.robot.kinematics import ConstantCurvature


class ConstantCurvaturePlant(ccr_host.Plant):
    """Takes the pose that its pulses ask for at once."""

    def __init__(self, description: ccr_host.Description) -> None:
        self._model, self._servo = ConstantCurvature(description.robot), description.servo
        self._q_rad = np.zeros(description.robot.motors)

    def set_pulses_half_us(self, pulses_half_us: tuple[int, ...]) -> None:
        if all(pulses_half_us):
            turn = np.array(pulses_half_us) / 2 - self._servo.neutral_pulse_us
            self._q_rad = np.radians(90 * turn / self._servo.pulse_per_90_deg_us)

    def advance_to(self, time_us: int) -> None:
        """It has nothing to do with time."""

    def markers_mm(self) -> NDArray[np.float64]:
        ends_mm, _ = self._model.markers_mm(self._model.bending_rad(self._q_rad)[None])
        return np.concatenate([np.zeros((1, 3)), ends_mm[0]])


if __name__ == "__main__":
    with ccr_host.open_robot(plant=ConstantCurvaturePlant) as robot:
        summary = robot.track("8shape", "mpc", with_open=False).summary
    print(f"mean true error {summary['true_mean_error_mm']:.2f} mm: the model is exact here")
