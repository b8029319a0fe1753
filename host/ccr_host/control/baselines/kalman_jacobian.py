"""Jacobian feedback with J's entries as the state of a Kalman filter.

As in model-free control of continuum robots (Li, Kang, Branson, Dai, IEEE/ASME T-Mech 23(1), 2018):
the entries walk at random, each motion dx = J dq + noise is a measurement of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.baselines.jacobian_feedback import JacobianFeedback, Tuning
from ccr_host.control.baselines.loop import PeerLoop
from ccr_host.description.schema import Description

FloatArray = NDArray[np.float64]


class KalmanEstimator:
    """The rows of J share one covariance, (2, 2): their regressors and noises are the same.

    Args:
        deviation_mm_rad: of the first guess.
        walk_mm_rad: of an entry per square root of a radian turned.
        noise_mm: of a measured motion, everything that is not linear included.
    """

    jacobian_mm_rad: FloatArray

    def __init__(
        self, deviation_mm_rad: float = 40.0, walk_mm_rad: float = 15.0, noise_mm: float = 1.5
    ) -> None:
        self._deviation_mm_rad = deviation_mm_rad
        self._walk_mm_rad = walk_mm_rad
        self._noise_mm = noise_mm

    def start(self, guess_mm_rad: FloatArray) -> None:
        self.jacobian_mm_rad = guess_mm_rad
        self._covariance = self._deviation_mm_rad**2 * np.eye(2)

    def correct(self, turn_rad: FloatArray, move_mm: FloatArray) -> None:
        turned_rad = float(np.linalg.norm(turn_rad))
        covariance = self._covariance + self._walk_mm_rad**2 * turned_rad * np.eye(2)
        spread = turn_rad @ covariance @ turn_rad + self._noise_mm**2
        gain = covariance @ turn_rad / spread
        unexplained_mm = move_mm - self.jacobian_mm_rad @ turn_rad
        self.jacobian_mm_rad = self.jacobian_mm_rad + np.outer(unexplained_mm, gain)
        self._covariance = covariance - spread * np.outer(gain, gain)


class KalmanJacobian(PeerLoop):
    """See the module."""

    name = "kalman-jacobian"

    def __init__(self, description: Description) -> None:
        super().__init__(description, JacobianFeedback(description, KalmanEstimator(), Tuning()))
