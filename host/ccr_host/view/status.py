"""The page in words: what goes on, and whether all is well."""

from __future__ import annotations

import html
import math

from ccr_host.link.messages import Fault, State
from ccr_host.run.observer import RunSetup
from ccr_host.view import palette
from ccr_host.view.history import Moment

_GOOD, _BAD = "#1b7837", "#c0392b"
_TROUBLED_STATES = frozenset({State.FAULT, State.STOPPED, State.RELAXING})


def status_html(setup: RunSetup, moment: Moment, dropped_batches: int = 0) -> str:
    """Table of what matters at a moment."""
    rows = [
        (
            "run",
            _text(f"{setup.reference.name}, {setup.options.controller}{setup.options.on_surface}"),
        ),
        ("phase", f"<b>{_text(_phase(moment))}</b>"),
        ("step", _step(setup, moment)),
        ("error", _error(moment)),
        ("board", _board(moment)),
        ("link", _link(moment)),
        ("tracker", _tracker(setup, moment)),
    ]
    if dropped_batches:
        rows.append(("page", f"lags: {dropped_batches} updates left out"))
    cells = "".join(
        f'<tr><td style="padding-right:0.8em;opacity:0.65">{name}</td><td>{text}</td></tr>'
        for name, text in rows
    )
    return f'<table style="font-size:0.8em;line-height:1.45;margin:0 0.9em">{cells}</table>'


def legend_html(full_scale_mm: float, setup: RunSetup) -> str:
    """What the colours of the scene mean."""
    controller, markers = setup.options.controller, setup.description.robot.markers
    entries = (
        (palette.MEASURED, "backbone through the measured markers"),
        (palette.MARKER, f"markers {', '.join(markers)}"),
        (palette.DESIRED, "desired path"),
        (palette.UNREACHABLE, "desired path out of reach"),
        (palette.of_controller(controller), f"target, and plan of {_text(controller)}"),
    )
    swatches = "".join(
        f'<div><span style="display:inline-block;width:1.6em;height:0.55em;margin-right:0.6em;'
        f'background:{palette.css(colour)};border:1px solid #8888"></span>{text}</div>'
        for colour, text in entries
    )
    scale = (
        f'<div style="margin-top:0.4em">trail: error of each step (mm)</div>'
        f'<div style="height:0.7em;background:{palette.error_gradient_css()}"></div>'
        f'<div style="display:flex;justify-content:space-between"><span>0</span>'
        f"<span>{full_scale_mm / 2:g}</span><span>{full_scale_mm:g} or more</span></div>"
    )
    return f'<div style="font-size:0.75em;line-height:1.5;margin:0 1.1em">{swatches}{scale}</div>'


def _phase(moment: Moment) -> str:
    if moment.phase is None:
        return "starting"
    done = moment.phase.done
    return moment.phase.name + ("" if done is None else f", {100 * done:.0f} %")


def _step(setup: RunSetup, moment: Moment) -> str:
    steps = len(setup.reference)
    if moment.record is None:
        return f"0 of {steps}"
    late = int(moment.steps.late.sum())
    note = _coloured(f", {late} late", _BAD) if late else ""
    return f"{moment.record.step + 1} of {steps}, path time {moment.record.time_s:.1f} s{note}"


def _error(moment: Moment) -> str:
    if moment.record is None:
        return "-"
    error_mm = moment.steps.error_mm[-1]
    if math.isnan(error_mm):
        return _coloured("markers lost", _BAD)
    outcome = moment.record.outcome.value
    return f"{error_mm:.2f} mm, command {outcome}"


def _board(moment: Moment) -> str:
    if moment.board is None:
        return "not heard yet"
    board = moment.board
    colour = _BAD if board.state in _TROUBLED_STATES else _GOOD
    state = _coloured(board.state.name.lower(), colour)
    fault = "" if board.fault is Fault.NONE else _coloured(f" {board.fault.name.lower()}", _BAD)
    widths = ", ".join(f"{pulse_us:g}" for pulse_us in board.pulses_us)
    pulses = f"pulses {widths} us" if any(board.pulses_us) else "no pulses"
    return f"<b>{state}</b>{fault}, {pulses}"


def _link(moment: Moment) -> str:
    if moment.link is None:
        return "-"
    link = moment.link
    trip = "" if math.isnan(link.round_trip_us) else f"{link.round_trip_us / 1000:.1f} ms, "
    troubles = [
        f"{count:g} {name}"
        for count, name in (
            (link.retries, "retries"),
            (link.lost_telemetry, "reports lost"),
            (link.board_errors, "damaged at the board"),
        )
        if count
    ]
    return trip + (_coloured(", ".join(troubles), _BAD) if troubles else "no errors, no retries")


def _tracker(setup: RunSetup, moment: Moment) -> str:
    lost = sum(map(math.isnan, moment.steps.age_us))
    lost_text = _coloured(f"steps without a sample: {lost}", _BAD) if lost else "no losses"
    if math.isnan(moment.markers_age_us):
        return "no markers yet"
    if moment.markers_mm is None:
        return _coloured(f"no markers for {moment.markers_age_us * 1e-6:.1f} s", _BAD)
    ages_us = [age for age in moment.steps.age_us[-1:] if not math.isnan(age)]
    age = f"age {ages_us[0] / 1000:.0f} ms, " if ages_us else ""
    return f"{_text(setup.options.tracker)} {age}{lost_text}"


def _coloured(text: str, colour: str) -> str:
    return f'<span style="color:{colour}">{_text(text)}</span>'


def _text(text: str) -> str:
    return html.escape(text)
