"""What each key does to the angles that are jogged."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.bringup.keyboard import DOWN, ESCAPE, LEFT, RIGHT, UP
from ccr_host.robot.workspace import MotorLimits

STEPS_DEG = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0)
_FIRST_STEP = 2

HELP = (
    ("up, down", "motor 1"),
    ("right, left", "motor 2"),
    ("+, -", "greater or smaller step"),
    ("0", "to the rest pose"),
    ("space, Esc", "STOP: no pulses from now on"),
    ("c", "clear a stop or a fault and arm again"),
    ("q", "disarm and leave"),
)

HELP_BACK = ("b, Backspace", "back to the question before")

_MOVES = {UP: (1, 0), DOWN: (-1, 0), RIGHT: (0, 1), LEFT: (0, -1)}


class Wish(enum.Enum):
    """What a key asks for besides another angle."""

    MOVE = enum.auto()
    STOP = enum.auto()
    CLEAR = enum.auto()
    ENTER = enum.auto()
    BACK = enum.auto()
    LEAVE = enum.auto()


_WISHES = {
    " ": Wish.STOP,
    ESCAPE: Wish.STOP,
    "c": Wish.CLEAR,
    "q": Wish.LEAVE,
    "\n": Wish.ENTER,
    "\r": Wish.ENTER,
    "b": Wish.BACK,
    "\b": Wish.BACK,
    "\x7f": Wish.BACK,
}


@dataclass(frozen=True)
class JogTarget:
    """Motor angles asked for, and how far one key moves them."""

    q_rad: NDArray[np.float64]
    """(2,)."""
    limits: MotorLimits
    rest_rad: NDArray[np.float64]
    """(2,)."""
    step: int = _FIRST_STEP
    """Index into `STEPS_DEG`."""

    @property
    def step_deg(self) -> float:
        """How far one key moves a motor."""
        return STEPS_DEG[self.step]

    def after(self, key: str) -> JogTarget:
        """The target once a key was pressed; keys without a meaning change nothing."""
        if key in _MOVES:
            motion_rad = np.radians(self.step_deg) * np.array(_MOVES[key])
            return replace(self, q_rad=self.limits.clip(self.q_rad + motion_rad))
        if key in ("+", "-"):
            step = self.step + (1 if key == "+" else -1)
            return replace(self, step=min(max(step, 0), len(STEPS_DEG) - 1))
        return replace(self, q_rad=self.rest_rad) if key == "0" else self


def wish_of(key: str) -> Wish:
    """What to do about a key."""
    return _WISHES.get(key, Wish.MOVE)
