"""Measurements made at rest, which the static model is fitted to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import Fit, Scaling, fit_statics
from ccr_host.control.adaptive.setpoint_history import SetpointHistory
from ccr_host.control.adaptive.statics import Drive

FloatArray = NDArray[np.float64]

SETTLED_AFTER_S = 0.15
"""A tip counts as resting so long after its servos."""
_FEWEST_RESTS = 20
_NOISE_MM = 0.35
"""Of a coordinate at rest: camera noise, ringing, the model's own error."""


class RestSurvey:
    """Collects measurements and fits the model to them.

    Args:
        scaling: prior of the parameters.
    """

    def __init__(self, scaling: Scaling) -> None:
        self._scaling = scaling
        self._drives: list[Drive] = []
        self._tips_mm: list[FloatArray] = []

    def add(self, history: SetpointHistory, time_s: float, tip_mm: FloatArray) -> None:
        """Keep a measurement if the setpoints had stood for long enough by then."""
        if time_s - history.resting_since(time_s) > SETTLED_AFTER_S:
            self._drives.append(history.at(time_s)[0])
            self._tips_mm.append(tip_mm)

    def fit(self) -> Fit | None:
        """What the measurements say; None if they are too few."""
        if len(self._tips_mm) < _FEWEST_RESTS:
            return None
        setpoints_rad, sides = zip(*self._drives, strict=True)
        drive = Drive(np.array(setpoints_rad), np.array(sides))
        return fit_statics(self._scaling, drive, np.array(self._tips_mm), _NOISE_MM)
