"""The page itself: lays out scene, status, buttons and charts, and keeps them up to date.

It lives in the server's thread, see `in_servers_thread`; there viser calls whatever is `async`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from viser import GuiButtonHandle, GuiEvent, Icon, ViserServer

from ccr_host.link.messages import Fault, State
from ccr_host.run.observer import RunSetup
from ccr_host.view import palette
from ccr_host.view.charts import Charts
from ccr_host.view.feed import SharedButtons
from ccr_host.view.history import Moment, RunHistory
from ccr_host.view.palette import error_full_scale_mm
from ccr_host.view.robot_scene import RobotScene, scale_of

SPEEDS = {"1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0}


@dataclass
class Playback:
    """Position of the page in the run, and its speed."""

    end_us: float
    at_us: float = 0.0
    playing: bool = False
    speed: float = 1.0

    def press_play(self) -> None:
        """Play or pause; at the end it begins again."""
        self.playing = not self.playing
        if self.playing and self.at_us >= self.end_us:
            self.at_us = 0.0

    def seek(self, at_us: float) -> None:
        """Jump there, or as near as there is; of what is no number to the beginning."""
        self.at_us = min(max(0.0, at_us), self.end_us)

    def advance(self, elapsed_us: float) -> None:
        """Let time pass before the page."""
        if self.playing:
            self.seek(self.at_us + self.speed * elapsed_us)
            self.playing = self.at_us < self.end_us


_PANEL_PX = 390
_SLOW_EVERY_US = 250_000
"""Charts, trail and text change four times a second, the robot as often as the page is drawn."""
_SLIDER_STEP_S = 0.1
_IDEAL = (
    "Light blue: the backbone by the constant-curvature model at the commanded angles, as if there "
    "were neither gravity nor slack nor friction. The real one gives way to them; nothing is wrong."
)
_CAMERA = (1.18, -2.0, 0.55)
_LOOKS_AT = (-0.05, -0.52, -0.27)


class Page:
    """One run, live or recorded.

    Nothing is shown on the server yet, and the setup of ``history`` is known. ``buttons`` are those
    of a live run; None for a recorded one.
    """

    def __init__(
        self, server: ViserServer, history: RunHistory, buttons: SharedButtons | None
    ) -> None:
        assert history.setup is not None, "drawn once the run has begun"
        self._server = server
        self._history = history
        self._setup = history.setup
        self._playback: Playback | None = None
        self._live_controls: list[GuiButtonHandle] = []
        self._drawn_us: float | None = None
        self._slow_due_us = 0
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label(f"ccr-host: {self._setup.reference.name}")
        scale = scale_of(self._setup.description.robot)
        server.initial_camera.position = scale * np.array(_CAMERA)
        server.initial_camera.look_at = scale * np.array(_LOOKS_AT)
        with gui.add_folder("Run"):
            if buttons is not None:
                self._live_controls = _add_live_controls(server, buttons)
            self._status = gui.add_html("")
        self._player = _Player(server)
        self._scene = RobotScene(server.scene, self._setup)
        with gui.add_folder("Legend"):
            self._legend = gui.add_html("")
            disks = gui.add_checkbox("disks", initial_value=True)
            ideal = gui.add_checkbox("ideal robot", initial_value=False, hint=_IDEAL)

            @disks.on_update
            async def _(_: object) -> None:
                self._scene.disks.visible = disks.value

            @ideal.on_update
            async def _(_: object) -> None:
                self._scene.ideal.visible = ideal.value

        plots = gui.add_panel()
        with plots.add_tab("Plots", Icon.CHART_LINE):
            self._charts = Charts(gui, self._setup)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_PX)
        plots.dock_left()
        plots.set_width(_PANEL_PX)
        if buttons is None:
            self.become_player(history)

    def become_player(self, history: RunHistory) -> None:
        """The run has ended: from now on it can be scrubbed."""
        self._history = history
        for control in self._live_controls:
            control.remove()
        self._live_controls = []
        self._playback = self._player.show(history.end_us)
        self._drawn_us = None

    def draw(self, now_us: int, elapsed_us: float, dropped_batches: int) -> None:
        """Bring the page up to date.

        ``now_us`` is of the page's own clock, ``elapsed_us`` since the last call.
        """
        at_us: float = self._history.end_us
        if self._playback is not None:
            self._playback.advance(elapsed_us)
            self._player.follow(self._playback)
            at_us = self._playback.at_us
        if at_us == self._drawn_us:
            return
        moment = self._history.at(at_us)
        with self._server.atomic():
            self._scene.show(moment)
            if now_us >= self._slow_due_us or not self._is_running():
                self._slow_due_us = now_us + _SLOW_EVERY_US
                self._draw_slow_parts(moment, dropped_batches)
        self._drawn_us = at_us

    def _is_running(self) -> bool:
        return self._playback is None or self._playback.playing

    def _draw_slow_parts(self, moment: Moment, dropped_batches: int) -> None:
        full_scale_mm = error_full_scale_mm(moment.steps.error_mm)
        self._scene.show_trail(moment, full_scale_mm)
        self._legend.content = legend_html(full_scale_mm, self._setup)
        self._status.content = status_html(self._setup, moment, dropped_batches)
        self._charts.show(self._history, moment)


class _Player:
    """Slider, play and speed; hidden while the run is live."""

    def __init__(self, server: ViserServer) -> None:
        gui = server.gui
        self._gui = gui
        self._folder = gui.add_folder("Replay", visible=False)
        with self._folder:
            self._play = gui.add_button("Play", icon=Icon.PLAYER_PLAY)
            self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1")
        self._playback = Playback(end_us=0.0)

    def show(self, end_us: float) -> Playback:
        """Offer a run of this length, shown at its end."""
        playback = self._playback = Playback(end_us, at_us=end_us)
        end_s = _SLIDER_STEP_S * math.ceil(max(end_us * 1e-6, 1.0) / _SLIDER_STEP_S)
        with self._folder:
            self._slider = self._gui.add_slider("time (s)", 0.0, end_s, _SLIDER_STEP_S, end_s)
        self._folder.visible = True

        @self._slider.on_update
        async def _(event: GuiEvent[Any]) -> None:
            if event.client is not None:
                playback.seek(self._slider.value * 1e6)

        @self._play.on_click
        async def _(_: object) -> None:
            playback.press_play()

        @self._speed.on_update
        async def _(_: object) -> None:
            playback.speed = SPEEDS.get(self._speed.value, playback.speed)

        return playback

    def follow(self, playback: Playback) -> None:
        """Show where the player stands."""
        self._play.label = "Pause" if playback.playing else "Play"
        if playback.playing:
            self._slider.value = playback.at_us * 1e-6  # type: ignore[misc]


def _add_live_controls(server: ViserServer, buttons: SharedButtons) -> list[GuiButtonHandle]:
    gui = server.gui
    stop = gui.add_button("STOP the robot", color="red", icon=Icon.HAND_STOP)
    pause = gui.add_button("Pause", icon=Icon.PLAYER_PAUSE)

    def show() -> None:
        stop.label = "Stop sent" if buttons.stop_pressed else "STOP the robot"
        pause.label = "Continue" if buttons.paused else "Pause"

    @stop.on_click
    async def _(_: object) -> None:
        buttons.press_stop()
        show()

    @pause.on_click
    async def _(_: object) -> None:
        buttons.set_pause(not buttons.paused)
        show()

    show()
    return [stop, pause]


_GOOD, _BAD = "#1b7837", "#c0392b"
_TROUBLED_STATES = frozenset({State.FAULT, State.STOPPED, State.RELAXING})


def status_html(setup: RunSetup, moment: Moment, dropped_batches: int = 0) -> str:
    """Table of what matters at a moment."""
    rows = [
        (
            "run",
            escape(f"{setup.reference.name}, {setup.options.controller}{setup.options.on_surface}"),
        ),
        ("phase", f"<b>{escape(_phase(moment))}</b>"),
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
        (palette.of_controller(controller), f"target, and plan of {escape(controller)}"),
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
    return f"{escape(setup.options.tracker)} {age}{lost_text}"


def _coloured(text: str, colour: str) -> str:
    return f'<span style="color:{colour}">{escape(text)}</span>'
