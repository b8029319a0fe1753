"""Colours of the page."""

from __future__ import annotations

import warnings

import numpy as np

from ccr_host.record.figure_style import controller_colours
from ccr_host.view import palette


def test_steps_without_a_sample_have_a_colour_and_raise_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        colours = palette.error_colours(np.array((np.nan, 0.0, 2.0, np.inf)), 1.0)
        alone = palette.error_colours(np.full(3, np.nan), palette.error_full_scale_mm(np.empty(0)))
    assert colours.shape == (4, 3)
    assert (colours[0] == alone).all()
    assert len({tuple(colour) for colour in colours[:3]}) == 3


def test_the_trail_is_neither_orange_nor_yellow() -> None:
    shown = palette.error_colours(np.linspace(0.0, 1.0, 50), 1.0).astype(float)
    for other in (palette.UNREACHABLE, palette.MARKER):
        assert np.linalg.norm(shown - other, axis=1).min() > 100


def test_nothing_on_the_page_but_what_is_out_of_reach_is_orange() -> None:
    others = [
        palette.MODEL, palette.MEASURED, palette.MARKER, palette.DESIRED, palette.LIMIT,
        *palette.MOTORS, *(palette.rgb(colour) for colour in controller_colours(()).values()),
    ]  # fmt: skip
    away = np.linalg.norm(np.array(others, dtype=float) - palette.UNREACHABLE, axis=1)
    assert away.min() > 60


def test_a_controller_has_the_colour_of_the_figures() -> None:
    assert palette.css(palette.of_controller("mpc")) == controller_colours(())["mpc"] + "ff"
