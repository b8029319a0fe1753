"""Measurements made at rest, which the static model is fitted to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import (
    Predict,
    Rests,
    Scaling,
    StaticsFit,
    predicted_mm,
)
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.control.adaptive.setpoint_history import SetpointHistory

FloatArray = NDArray[np.float64]

SETTLED_AFTER_S = 0.15
"""A tip counts as resting so long after its servos."""
_FEWEST_RESTS = 10
_BELIEVABLE_MM = 60.0
"""Random robots of the kind are 10 to 30 mm off the prior; markers mixed up are further."""


class RestSurvey:
    """Collects measurements and prepares the fit of the model to them.

    Args:
        scaling: prior of the parameters.
        start_rad: where the servos stood before, (2,).
        predict: for the fit, instead of ``predicted_mm``.
    """

    def __init__(
        self, scaling: Scaling, start_rad: FloatArray, predict: Predict | None = None
    ) -> None:
        self._predict = predict
        self._scaling = scaling
        self._start_rad = start_rad
        self._setpoints_rad: list[FloatArray] = []
        self._markers_mm: list[list[FloatArray]] = []

    def add(self, history: SetpointHistory, time_s: float, markers_mm: FloatArray) -> None:
        """Keep a measurement if the setpoints had stood for long enough by then."""
        if time_s - history.resting_since(time_s) < SETTLED_AFTER_S:
            return
        setpoint = history.at(time_s)
        if not self._setpoints_rad or not np.array_equal(setpoint, self._setpoints_rad[-1]):
            self._setpoints_rad.append(setpoint)
            self._markers_mm.append([])
        self._markers_mm[-1].append(markers_mm)

    def rests(self) -> Rests:
        """What was measured."""
        return Rests(
            self._start_rad,
            np.array(self._setpoints_rad).reshape(-1, 2),
            np.array([np.mean(seen, axis=0) for seen in self._markers_mm]).reshape(-1, 2, 3),
            np.array([float(len(seen)) for seen in self._markers_mm]),
        )

    def fit(self) -> StaticsFit | None:
        """The fit to what was measured, yet to be made; None if it makes no sense."""
        return fit_to(self._scaling, self.rests(), self._predict)


def fit_to(scaling: Scaling, rests: Rests, predict: Predict | None = None) -> StaticsFit | None:
    """The fit to rests, yet to be made; None if there are few, or no such robot rests there."""
    if len(rests.setpoint_rad) < _FEWEST_RESTS:
        return None
    prior = scaling.parameters(np.zeros(COUNT))
    off_mm = np.linalg.norm(rests.tip_mm - predicted_mm(prior, rests)[:, 1], axis=1)
    if not np.median(off_mm) < _BELIEVABLE_MM:
        return None
    return StaticsFit(scaling, rests, predict)
