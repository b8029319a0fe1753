"""The plots over the time of the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from viser import GuiApi, uplot

from ccr_host.core.arrays import Array, IntArray
from ccr_host.core.errors import CcrError
from ccr_host.record.figure_style import BESIDE_THE_TRUTH
from ccr_host.run.observer import RunSetup
from ccr_host.tracking.uri import parse_tracker_uri
from ccr_host.view import palette
from ccr_host.view.history import Moment, RunHistory


def peak_rows(values: Array, most: int) -> IntArray:
    """Indices of about ``most`` rows: the greatest of each stretch of equal length, and the newest.

    ``values``, (N,), are without NaN; with no more than ``most``, all are taken.
    """
    count = len(values)
    if count <= most:
        return np.arange(count)
    stretch = -(-count // most)
    starts = range(0, count, stretch)
    peaks = [start + int(values[start : start + stretch].argmax()) for start in starts]
    return np.union1d(peaks, [count - 1])


_POINTS = 600
"""More than the panel has pixels."""
_HEIGHT_PX = 108
_FONT = "11px sans-serif"
_FIRST_END_S = 30.0


@dataclass(frozen=True)
class Curve:
    """One line of a chart."""

    label: str
    colour: palette.Rgb
    opacity: float = 1.0
    dash: tuple[int, ...] = ()


class Charts:
    """Error, motor angles, computing time, link and tracker."""

    def __init__(self, gui: GuiApi, setup: RunSetup) -> None:
        servo, control = setup.description.servo, setup.description.control
        self._limits_deg = sorted({*servo.angle_min_deg, *servo.angle_max_deg})
        self._stale_ms = float(control.stale_after_ms)
        self._motors = setup.description.robot.motors
        self._knows_truth = _sees_simulated_robot(setup.options.tracker)
        self._end_s = _FIRST_END_S
        own, first = palette.of_controller(setup.options.controller), palette.MOTORS[0]
        opacity = BESIDE_THE_TRUTH if self._knows_truth else 1.0
        self._error = _Chart(
            gui,
            "tip error (mm)",
            Curve("measured", own, opacity),
            Curve("unavoidable", palette.UNREACHABLE, dash=(4, 4)),
            *([Curve("true", own)] if self._knows_truth else []),
        )
        self._angles = _Chart(
            gui,
            "motor angles (deg)",
            *(Curve(f"motor {n + 1}", palette.MOTORS[n]) for n in range(self._motors)),
            *(Curve(f"limit {deg:g}", palette.LIMIT, dash=(6, 4)) for deg in self._limits_deg),
        )
        self._solve = _Chart(gui, "controller (ms a step)", Curve("computing time", first))
        self._link = _Chart(gui, "link (ms)", Curve("round trip", first))
        self._tracker = _Chart(
            gui,
            "tracker (ms)",
            Curve("age of the sample", first),
            Curve("lost", palette.LIMIT, dash=(6, 4)),
        )

    def show(self, history: RunHistory, moment: Moment) -> None:
        """Draw everything up to a moment, over the time of the whole run so far."""
        end_s = axis_end_s(history.end_us * 1e-6)
        if end_s != self._end_s:
            self._end_s = end_s
            for chart in (self._error, self._angles, self._solve, self._link, self._tracker):
                chart.set_end_s(end_s)
        steps = moment.steps
        at_s = steps.end_us * 1e-6
        truth = (steps.true_error_mm,) if self._knows_truth else ()
        self._error.show(at_s, (steps.error_mm, steps.unavoidable_mm, *truth))
        setpoints = history.link.setpoints_until(moment.time_us)
        angles_deg = np.degrees(setpoints[:, 1:]).T
        limits = [np.full(len(setpoints), limit) for limit in self._limits_deg]
        self._angles.show(setpoints[:, 0] * 1e-6, (*angles_deg, *limits))
        self._solve.show(at_s, (steps.solve_us * 1e-3,))
        trips = history.link.round_trips_until(moment.time_us)
        self._link.show(trips[:, 0] * 1e-6, (trips[:, 1] * 1e-3,))
        stale_ms = np.full(len(at_s), self._stale_ms)
        age_ms = np.where(np.isnan(steps.age_us), stale_ms, steps.age_us * 1e-3)
        self._tracker.show(at_s, (age_ms, stale_ms))


def axis_end_s(time_s: float) -> float:
    """A round end of the time axis at or after a time: the axis changes seldom."""
    end_s = _FIRST_END_S
    while end_s < time_s:
        end_s = end_s * 1.5 if math.log2(end_s / _FIRST_END_S).is_integer() else end_s / 0.75
    return end_s


class _Chart:
    """One plot over time."""

    def __init__(self, gui: GuiApi, title: str, *curves: Curve) -> None:
        self._plot = gui.add_uplot(
            data=(np.array((0.0, 1.0)), *(np.zeros(2) for _ in curves)),
            series=({"label": "time (s)"}, *(_series(curve) for curve in curves)),
            title=title,
            scales={"x": _time_until(_FIRST_END_S)},
            cursor={"sync": {"key": "run"}},
            axes=(
                {"label": "time (s)", "labelSize": 15, "size": 24, "font": _FONT,
                 "labelFont": _FONT},
                {"size": 44, "font": _FONT, "space": 20},
            ),
            legend={"live": False},
            padding=(6, 12, 0, 0),
            height=_HEIGHT_PX,
        )  # fmt: skip

    def set_end_s(self, end_s: float) -> None:
        """Let the time axis end there; the browser builds the chart again."""
        self._plot.scales = {"x": _time_until(end_s)}

    def show(self, at_s: Array, curves: Sequence[Array]) -> None:
        """Draw curves of one length over their common time; rows with NaN are left out.

        The browser finds no scale among NaN.
        """
        known = np.flatnonzero(np.isfinite(np.stack(curves)).all(axis=0))
        if len(known) < 2:  # noqa: PLR2004 - no span to draw over yet
            return
        chosen = known[peak_rows(curves[0][known], _POINTS)]
        self._plot.data = tuple(column[chosen] for column in (at_s, *curves))


def _time_until(end_s: float) -> uplot.Scale:
    return {"time": False, "range": (0.0, end_s)}


def _series(curve: Curve) -> uplot.Series:
    series: uplot.Series = {
        "label": curve.label,
        "stroke": palette.css(curve.colour, curve.opacity),
        "width": 1.5,
        "points": {"show": False},
    }
    if curve.dash:
        series["dash"] = curve.dash
    return series


def _sees_simulated_robot(tracker: str) -> bool:
    """A plug-in may be gone by the time its run is played; it may have seen a simulated robot."""
    with suppress(CcrError):
        return parse_tracker_uri(tracker).is_simulated
    return True
