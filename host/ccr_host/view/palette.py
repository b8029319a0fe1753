"""Colours of the page: Okabe and Ito's, which people with colour blindness can tell apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Rgb = tuple[int, int, int]

MODEL: Rgb = (86, 180, 233)
MEASURED: Rgb = (45, 45, 45)
MARKER: Rgb = (240, 228, 66)
DESIRED: Rgb = (150, 150, 150)
UNREACHABLE: Rgb = (213, 94, 0)
HORIZON: Rgb = (0, 158, 115)
MOTOR_1: Rgb = (0, 114, 178)
MOTOR_2: Rgb = (204, 121, 167)
LIMIT: Rgb = (213, 94, 0)
AXES: tuple[Rgb, ...] = ((190, 60, 60), (60, 140, 60), (60, 80, 190))

_ERROR_STOPS: FloatArray = np.array(
    [(13, 8, 135), (126, 3, 168), (204, 71, 120), (248, 149, 64), (252, 206, 37)], dtype=np.float64
)
"""Small to large: Matplotlib's plasma, without its lightest end."""
_NICE = (1.0, 1.5, 2.0, 3.0, 5.0, 7.5)
_LEAST_SCALE_MM = 0.1
_SCALE_QUANTILE = 0.95
"""A few steps far off, as at the start, must not make all others look alike."""


def css(colour: Rgb) -> str:
    """As style sheets write it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def error_colours(error_mm: FloatArray, full_scale_mm: float) -> NDArray[np.uint8]:
    """RGB of errors, (N,) -> (N, 3); larger ones than full scale take its colour."""
    share = np.clip(error_mm / full_scale_mm, 0.0, 1.0) * (len(_ERROR_STOPS) - 1)
    stops = np.arange(len(_ERROR_STOPS))
    channels = [np.interp(share, stops, channel) for channel in _ERROR_STOPS.T]
    return np.stack(channels, axis=-1).astype(np.uint8)


def error_full_scale_mm(error_mm: FloatArray) -> float:
    """A round number that 95 % of the errors do not exceed."""
    known = error_mm[np.isfinite(error_mm)]
    wanted = float(np.quantile(known, _SCALE_QUANTILE)) if len(known) else 1.0
    wanted = max(wanted, _LEAST_SCALE_MM)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next((n * power for n in _NICE if n * power >= wanted), 10.0 * power))


def error_gradient_css() -> str:
    """The colour scale from left to right."""
    stops = ", ".join(css((int(r), int(g), int(b))) for r, g, b in _ERROR_STOPS)
    return f"linear-gradient(to right, {stops})"
