"""``ccr-host calibrate --by-eye``: the user leads each servo to known angles and marks them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ccr_host.bringup.jog import JogView, jog
from ccr_host.bringup.servo_marks import QUESTIONS, Question, servo_from_marks
from ccr_host.config import Description, Servo
from ccr_host.link.messages import StateReport, StatusFlags
from ccr_host.run.rig import Rig

Show = Callable[[JogView, Question, int], None]
"""Draws the robot, what is asked, and how many questions were answered before."""


def calibrate_by_eye(
    rig: Rig, description: Description, pressed: Callable[[], Iterable[str]], show: Show
) -> Servo | None:
    """Ask all questions; None if the user leaves before the last one.

    Raises:
        ConfigError: marks that no servo would give.
        DeviceError: the board cannot be armed or disarmed.
    """
    pulses_us: list[float] = []

    def mark(report: StateReport) -> bool:
        axis = QUESTIONS[len(pulses_us)].axis
        half_us = report.pulse_half_us[axis]
        if half_us and not report.flags & StatusFlags.MOVING:
            pulses_us.append(half_us / 2)
        return len(pulses_us) == len(QUESTIONS)

    def show_question(view: JogView) -> None:
        asked = min(len(pulses_us), len(QUESTIONS) - 1)
        show(view, QUESTIONS[asked], asked)

    done = jog(rig, description, pressed, show_question, mark)
    return servo_from_marks(description.servo, pulses_us) if done else None
