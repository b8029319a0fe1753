"""Learns from lap to lap the offset that the model does not explain along a closed path.

Iterative learning with a zero-phase filter, m_{k+1} = m_k + gain Q (d_k - m_k), where d_k is the
offset of tip and model in lap k; docs/control-statics.md has the condition of convergence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_GAIN = 0.5
"""Learning gain: half, so that noise and a single bad lap are averaged out."""
_SMOOTHING_S = 1.0
"""Standard deviation of the filter's Gaussian: nothing is learnt above 0.4 Hz, a tenth of the
lowest resonance; errors of the static model change over some ten seconds of a path."""
_SMOOTHING_STEPS = 0.7
"""Minimum standard deviation: that of (1, 2, 1) / 4, for slow sampling."""
_LARGEST_MM = 2.0
"""Limit of what is learnt from a measurement: more is a payload, a push or confused markers."""


class LapMemory:
    """Tip offset by phase of the path.

    Args:
        steps: number of steps of a lap.
        period_s: duration of a step.
    """

    def __init__(self, steps: int, period_s: float) -> None:
        self._steps = steps
        self._lap = 0
        self._offset_mm = np.zeros((steps, 3))
        self._news_mm = np.zeros((steps, 3))
        self._filter = _low_pass(steps, max(_SMOOTHING_S / period_s, _SMOOTHING_STEPS))

    def at(self, index: float) -> FloatArray:
        """The offset learnt from earlier laps at a fractional step of the whole path, (3,) mm."""
        if self._lap == 0:
            return np.zeros(3)
        before = int(np.floor(index))
        share = index - before
        first = self._offset_mm[before % self._steps]
        second = self._offset_mm[(before + 1) % self._steps]
        return np.asarray((1.0 - share) * first + share * second)

    def note(self, index: float, unexplained_mm: FloatArray, trust: float) -> None:
        """Note measured minus modelled tip, (3,), at a fractional step; trust is from 0 to 1."""
        if index < 0.0:
            return
        step = round(index) % self._steps
        news_mm = unexplained_mm - self._offset_mm[step]
        share = min(1.0, _LARGEST_MM / max(float(np.linalg.norm(news_mm)), 1e-9))
        self._news_mm[step] = trust * share * news_mm

    def turn(self, index: float) -> FloatArray | None:
        """Learn from the last lap when a new one has begun.

        Returns:
            The resulting change of the offset here, (3,) mm; None within a lap.
        """
        if index < (self._lap + 1) * self._steps:
            return None
        before_mm = self.at(index)
        spectrum = np.fft.rfft(self._news_mm, axis=0) * self._filter[:, None]
        news_mm = np.fft.irfft(spectrum, n=self._steps, axis=0)
        self._offset_mm += _GAIN * news_mm
        self._news_mm[:] = 0.0
        self._lap += 1
        return self.at(index) - before_mm


def _low_pass(steps: int, deviation_steps: float) -> FloatArray:
    """Frequency response of a Gaussian on the closed path: real, between 0 and 1."""
    angle = 2.0 * np.pi * np.fft.rfftfreq(steps)
    response: FloatArray = np.exp(-0.5 * (deviation_steps * angle) ** 2)
    return response
