"""Colours of the page; what the figures show too has the same colour there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.arrays import Array
from ccr_host.record import figure_style

Rgb = tuple[int, int, int]


def rgb(colour: str) -> Rgb:
    """RGB of ``#rrggbb``."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


MODEL: Rgb = (86, 180, 233)
MEASURED: Rgb = (45, 45, 45)
MARKER: Rgb = (240, 228, 66)
DESIRED = rgb(figure_style.DESIRED)
UNREACHABLE = rgb(figure_style.UNREACHABLE)
MOTORS = tuple(rgb(colour) for colour in figure_style.MOTORS)
LIMIT = rgb(figure_style.LIMIT)
AXES: tuple[Rgb, ...] = ((190, 60, 60), (60, 140, 60), (60, 80, 190))

_ERROR_STOPS: Array = np.array(
    [(130, 175, 245), (75, 105, 230), (120, 50, 200), (170, 0, 130), (110, 0, 40)], dtype=np.float64
)
"""Small to large, ever darker; neither the orange of what is out of reach nor a marker's yellow."""
_UNKNOWN: Rgb = (200, 200, 200)
_NICE = (1.0, 1.5, 2.0, 3.0, 5.0, 7.5)
_LEAST_SCALE_MM = 0.1
_SCALE_QUANTILE = 0.95
"""A few steps far off, as at the start, must not make all others look alike."""


def of_controller(name: str) -> Rgb:
    """The controller's own colour."""
    return rgb(figure_style.controller_colours([name])[name])


def css(colour: Rgb, opacity: float = 1.0) -> str:
    """Colour as style sheets write it."""
    return "#{:02x}{:02x}{:02x}{:02x}".format(*colour, round(255 * opacity))


def error_colours(error_mm: Array, full_scale_mm: float) -> NDArray[np.uint8]:
    """RGB of errors, (N,) -> (N, 3); larger ones than full scale take its colour, NaN is grey."""
    is_known = np.isfinite(error_mm)
    share = np.clip(np.where(is_known, error_mm, 0.0) / full_scale_mm, 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_ERROR_STOPS))
    channels = [np.interp(share, stops, channel) for channel in _ERROR_STOPS.T]
    colours = np.where(is_known[:, None], np.stack(channels, axis=-1), _UNKNOWN)
    return colours.astype(np.uint8)


def error_full_scale_mm(error_mm: Array) -> float:
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
