"""The player's position in a recorded run."""

from __future__ import annotations

from dataclasses import dataclass

SPEEDS = {"1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0}


@dataclass
class Playback:
    """Where in the run the page stands, and how it goes on."""

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
