"""A controller of your own: the geometric solution, corrected by what was missed so far.

ccr-host track 8shape --controller examples/own_controller.py:IntegralFeedback
"""

import numpy as np

import ccr_host
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

GAIN = 0.3


class IntegralFeedback:
    """Integrates the tip error of each step in motor angles."""

    def __init__(self, description: ccr_host.Description) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)

    def start(self, reference: Reference) -> ccr_host.Command:
        self._reference = reference
        self._correction_rad = np.zeros_like(reference.q_rad[0])
        return self._command(0)

    def step(self, observation: ccr_host.Observation) -> ccr_host.Command:
        if observation.tip_mm is not None:
            missed_mm = self._reference.target_mm[observation.step - 1] - observation.tip_mm
            jacobian = self._model.jacobian_mm_rad(observation.q_rad)
            self._correction_rad += GAIN * np.linalg.pinv(jacobian) @ missed_mm
        return self._command(observation.step)

    def _command(self, step: int) -> ccr_host.Command:
        q_rad = self._limits.clip(self._reference.q_rad[step] + self._correction_rad)
        return ccr_host.Command(q_rad, np.empty((0, 3)), ccr_host.Outcome.SOLVED)


if __name__ == "__main__":
    with ccr_host.open_robot() as robot:
        summary = robot.track("8shape", IntegralFeedback).summary
    print(f"mean error {summary['mean_error_mm']:.1f} mm,", end=" ")
    print(f"open loop {summary['open']['mean_error_mm']:.1f} mm")
