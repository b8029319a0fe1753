"""The page itself: lays out scene, status, buttons and charts, and keeps them up to date.

It lives in the server's thread, see `in_servers_thread`; there viser calls whatever is `async`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from viser import GuiButtonHandle, GuiEvent, Icon, ViserServer

from ccr_host.view.charts import Charts
from ccr_host.view.feed import SharedButtons
from ccr_host.view.history import Moment, RunHistory
from ccr_host.view.palette import error_full_scale_mm
from ccr_host.view.robot_scene import RobotScene, scale_of
from ccr_host.view.status import legend_html, status_html

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

    Args:
        server: on which nothing is shown yet.
        history: of the run; its setup is known.
        buttons: of a live run; None for a recorded one.
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
                self._scene.show_disks(disks.value)

            @ideal.on_update
            async def _(_: object) -> None:
                self._scene.show_model(ideal.value)

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

        Args:
            now_us: of the page's own clock.
            elapsed_us: since the last call.
            dropped_batches: by the feed.
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
