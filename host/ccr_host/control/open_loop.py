"""Algorithm 2 of the paper: integrate the inverse Jacobian along the path, no feedback."""

from __future__ import annotations

import numpy as np

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits

SINGULAR_BELOW = 0.05
"""Fraction of J's largest singular value below which a direction is dropped.

With the paper's geometry the fraction stays above 0.2 out to the folds of the workspace, so nothing
is dropped and Algorithm 2 runs as printed. In other geometries a direction is dropped before a path
step of 1 mm would ask for more than about 6 deg of motor."""


class OpenLoop:
    """u_i = J^+(f_(i-1)) (f_i - f_(i-1)), with J at the configuration that reaches f_(i-1).

    J is 3 x n, so its inverse is the pseudo-inverse, truncated near rank loss. With fewer than
    three motors it projects out desired steps that leave the workspace, and they are regained when
    the path returns; with more it turns the motors as little as the step needs. The raw
    path is therefore differentiated: differences of the reachable one would not add up any better.
    """

    name = "open-loop"

    def __init__(self, description: Description) -> None:
        self._model = ConstantCurvature(description.robot)
        self._limits = MotorLimits.of(description.servo)

    def start(self, reference: Reference) -> Command:
        """Return the nearest reachable configuration of the first sample."""
        self._reference = reference
        self._q_rad = self._limits.clip(reference.q_rad[0])
        self._step = 0
        return self._command()

    def step(self, observation: Observation) -> Command:
        """Apply the increments of Algorithm 2 since the last command; ignores measurements."""
        desired_mm = self._reference.target_mm
        for i in range(self._step + 1, observation.step + 1):
            jacobian = self._model.jacobian_mm_rad(self._reference.q_rad[i - 1])
            inverse = np.linalg.pinv(jacobian, rcond=SINGULAR_BELOW)
            increment_rad = inverse @ (desired_mm[i] - desired_mm[i - 1])
            self._q_rad = self._limits.clip(self._q_rad + increment_rad)
        self._step = observation.step
        return self._command()

    def _command(self) -> Command:
        return Command(self._q_rad, self._model.tip_mm(self._q_rad)[None, :], Outcome.SOLVED)
