"""``ccr-host calibrate --by-eye``: the user leads each servo to known angles and marks them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ccr_host.bringup.jog import JogView, jog
from ccr_host.bringup.servo_marks import QUESTIONS, check_marks, doubts_about, servo_from_marks
from ccr_host.config import Description, Servo
from ccr_host.errors import ConfigError
from ccr_host.link.messages import StateReport, StatusFlags
from ccr_host.run.rig import Rig

Show = Callable[[JogView, str], None]
"""Draws the robot and what is asked."""


def calibrate_by_eye(
    rig: Rig, description: Description, pressed: Callable[[], Iterable[str]], show: Show
) -> Servo | None:
    """Ask all questions; None if the user leaves before the last one.

    Raises:
        DeviceError: the board cannot be armed or disarmed.
    """
    dialogue = _Dialogue(description.servo)

    def show_question(view: JogView) -> None:
        show(view, dialogue.asked)

    done = jog(rig, description, pressed, show_question, dialogue.mark, dialogue.back)
    return dialogue.servo() if done else None


class _Dialogue:
    """Questions and answers; marks that no servo would give are asked for again."""

    def __init__(self, servo: Servo) -> None:
        self._before = servo
        self._pulses_us: list[float] = []
        self._refused = ""
        """Why the last marks have to be made again; empty if they need not."""

    @property
    def asked(self) -> str:
        """The question that is to be answered, with whatever the user has to know first."""
        number = len(self._pulses_us)
        if number == len(QUESTIONS):
            doubts = "; ".join(self._doubts())
            return f"{doubts}.\nEnter keeps this, b goes back, q leaves" if doubts else ""
        question = f"{number + 1} of {len(QUESTIONS)}: {QUESTIONS[number].text}, then Enter"
        return f"{self._refused}\n{question}" if self._refused else question

    def mark(self, report: StateReport) -> bool:
        """Take the present pulse for an answer, or the user's word that all of them are right."""
        if len(self._pulses_us) == len(QUESTIONS):
            return True
        half_us = report.pulse_half_us[QUESTIONS[len(self._pulses_us)].axis]
        if not half_us or report.flags & StatusFlags.MOVING:
            return False
        self._pulses_us.append(half_us / 2)
        self._refused = ""
        try:
            check_marks(self._before, self._pulses_us)
        except ConfigError as error:
            self._refused = str(error)
            self.back()
        return len(self._pulses_us) == len(QUESTIONS) and not self._doubts()

    def back(self) -> None:
        """Take the last answer back."""
        if self._pulses_us:
            self._pulses_us.pop()

    def servo(self) -> Servo:
        """As marked, once all questions are answered."""
        return servo_from_marks(self._before, self._pulses_us)

    def _doubts(self) -> list[str]:
        return doubts_about(self._before, self.servo())
