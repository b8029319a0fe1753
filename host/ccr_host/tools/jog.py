"""``ccr-host jog``: move the motors with keys, which the terminal reports as they are pressed."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from typing import Self, TextIO

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.description.schema import Description
from ccr_host.link.client import Client
from ccr_host.link.messages import StateReport
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rig import Rig
from ccr_host.tracking.tracker import Sample

try:
    import termios
    import tty
except ModuleNotFoundError:  # on Windows
    _SUPPORTED = False
else:
    _SUPPORTED = True

ESCAPE = "\x1b"
UP, DOWN, RIGHT, LEFT = (f"{ESCAPE}[{letter}" for letter in "ABCD")
_CHUNK = 1024
_APPLICATION_MODE = "O"
"""Some terminals send ESC O A instead of ESC [ A for the arrow keys."""


class Keyboard:
    """Reads keys as they are pressed; a context manager.

    ``stream`` is the terminal; None for standard input.

    Raises:
        ConfigError: not a terminal, or one that does not report single keys.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        stream = stream or sys.stdin  # None if the shell has closed it
        if stream is None or stream.closed or not stream.isatty():
            raise ConfigError("standard input is not a terminal", "start it from a terminal")
        if not _SUPPORTED:
            raise ConfigError("single keys cannot be read here", "use Linux, macOS or WSL")
        self._file = stream.fileno()

    def __enter__(self) -> Self:
        try:
            self._before = termios.tcgetattr(self._file)
            tty.setcbreak(self._file)
        except (termios.error, OSError) as error:
            raise ConfigError(
                f"the terminal does not report single keys ({error})",
                "start it from another terminal",
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(termios.error, OSError):  # the terminal may be gone
            termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def pressed(self) -> list[str]:
        """Keys since the last call; arrows as `UP` and so on.

        Raises:
            KeyboardInterrupt: the terminal is gone.
        """
        try:
            if not select.select([self._file], [], [], 0)[0]:
                return []
            data = os.read(self._file, _CHUNK)
        except (OSError, ValueError):
            raise KeyboardInterrupt from None
        if not data:
            raise KeyboardInterrupt
        return split_keys(data.decode("utf-8", errors="replace"))


def split_keys(text: str) -> list[str]:
    """Single characters, and escape sequences as a whole."""
    keys: list[str] = []
    rest = text
    while rest:
        length = _sequence_length(rest)
        keys.append(rest[:length].replace(f"{ESCAPE}{_APPLICATION_MODE}", f"{ESCAPE}["))
        rest = rest[length:]
    return keys


def _sequence_length(text: str) -> int:
    if not text.startswith((f"{ESCAPE}[", f"{ESCAPE}{_APPLICATION_MODE}")):
        return 1
    for index, letter in enumerate(text[2:], start=2):
        if letter.isalpha() or letter == "~":
            return index + 1
    return len(text)


STEPS_DEG = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0)
_FIRST_STEP = 2

_HELP = (
    ("+, -", "larger or smaller step"),
    ("0", "go to the rest pose"),
    ("space, Esc", "STOP: no more pulses"),
    ("c", "clear a stop or a fault and arm again"),
    ("q", "disarm and quit"),
)
_ARROWS = ("up, down", "right, left")
_PAIR = len(_ARROWS)
"""Number of motors that the arrows move."""

HELP_BACK = ("b, Backspace", "back to the previous question")

_MOVES = {UP: (0, 1), DOWN: (0, -1), RIGHT: (1, 1), LEFT: (1, -1)}
"""Which of both motors an arrow moves, and its direction."""


STOP, CLEAR, QUIT = {" ", ESCAPE}, {"c"}, {"q"}
ENTER, BACK = {"\n", "\r"}, {"b", "\b", "\x7f"}
"""Keys that do not move."""


@dataclass(frozen=True)
class JogTarget:
    """Commanded motor angles, and the step of one key press."""

    q_rad: Array
    """Commanded angles, (motors,)."""
    limits: MotorLimits
    rest_rad: Array
    """Rest pose, (motors,)."""
    step: int = _FIRST_STEP
    """Index into `STEPS_DEG`."""
    pair: int = 0
    """Which two motors the arrows move: 0 the first two, 1 the next two, and so on."""

    @property
    def step_deg(self) -> float:
        """Angle by which one key press moves a motor."""
        return STEPS_DEG[self.step]

    @property
    def moved(self) -> range:
        """The motors that the arrows move, from 0."""
        first = _PAIR * self.pair
        return range(first, min(first + _PAIR, len(self.q_rad)))

    @property
    def help(self) -> list[tuple[str, str]]:
        arrows = [(keys, f"motor {n + 1}") for keys, n in zip(_ARROWS, self.moved, strict=False)]
        pairs = self._pairs
        others = [(f"1 .. {pairs}", "the two motors that the arrows move")] if pairs > 1 else []
        return [*arrows, *others, *_HELP]

    @property
    def _pairs(self) -> int:
        return -(-len(self.q_rad) // _PAIR)

    def after(self, key: str) -> JogTarget:
        """The target after a key press; unassigned keys have no effect."""
        if key in _MOVES:
            which, way = _MOVES[key]
            if which >= len(self.moved):
                return self
            motion_rad = np.zeros(len(self.q_rad))
            motion_rad[self.moved[which]] = way * np.radians(self.step_deg)
            return replace(self, q_rad=self.limits.clip(self.q_rad + motion_rad))
        if key in [str(number + 1) for number in range(self._pairs)]:
            return replace(self, pair=int(key) - 1)
        if key in ("+", "-"):
            step = self.step + (1 if key == "+" else -1)
            return replace(self, step=min(max(step, 0), len(STEPS_DEG) - 1))
        return replace(self, q_rad=self.rest_rad) if key == "0" else self


_PERIOD_US = 50_000
_VALIDITY_MS = 500
"""The board holds its pose if the host sends nothing for this time."""


@dataclass(frozen=True)
class JogView:
    """State shown while the robot is jogged."""

    target: JogTarget
    report: StateReport | None
    sample: Sample | None
    sample_age_us: int | None
    trouble: str
    """Why the robot does not move; empty if it does."""


Entered = Callable[[StateReport], bool]
"""Called with the board's state when Enter is pressed; returns whether that ends the jog."""


def jog(
    rig: Rig,
    description: Description,
    pressed: Callable[[], Iterable[str]],
    show: Callable[[JogView], None],
    entered: Entered = lambda _: False,
    back: Callable[[], object] = lambda: None,
) -> bool:
    """Arm, follow the keys until the user quits, disarm.

    After a stop or a fault, including one from before, the board keeps its state until the key for
    clearing is pressed. ``pressed`` returns the keys pressed since the last call; ``show`` is
    called once per period, ``entered`` when Enter is pressed and the robot can move, ``back`` with
    the key for going back.

    Returns:
        Whether `entered` ended the jog.

    Raises:
        DeviceError: the board cannot be disarmed at the end.
    """
    rest_rad = np.radians(description.servo.rest_deg)
    target = JogTarget(rest_rad, MotorLimits.of(description.servo), rest_rad)
    trouble = _armed(rig.client)
    done = False
    while not done:
        due_us = rig.clock.now_us()
        keys = list(pressed())
        target = reduce(JogTarget.after, keys, target)
        try:
            if STOP.intersection(keys):
                rig.client.stop()
                trouble = "stopped by key"
            elif QUIT.intersection(keys):
                break
            elif BACK.intersection(keys):
                back()
            elif CLEAR.intersection(keys) and trouble:
                rig.client.clear_fault()
                target, trouble = replace(target, q_rad=rest_rad), _armed(rig.client)
            if not trouble:
                ramp_ms = _PERIOD_US // 1000
                rig.client.set_target(target.q_rad, ramp_ms=ramp_ms, validity_ms=_VALIDITY_MS)
                if ENTER.intersection(keys):
                    done = entered(rig.client.read_state())
            show(_view(rig, target, trouble))
            rig.clock.sleep_until_us(due_us + _PERIOD_US)
        except DeviceError as error:
            trouble = error.cause
    if not trouble:
        rig.client.disarm()
    return done


def _armed(client: Client) -> str:
    """Arm; return why the board cannot be armed, empty if it is."""
    try:
        client.arm()
    except DeviceError as error:
        return error.cause
    return ""


def _view(rig: Rig, target: JogTarget, trouble: str) -> JogView:
    sample = rig.tracker.newest()
    telemetry = rig.client.telemetry
    return JogView(
        target=target,
        report=None if telemetry is None else telemetry.report,
        sample=sample,
        sample_age_us=None if sample is None else rig.clock.now_us() - sample.exposed_us,
        trouble=trouble,
    )
